//! Series of numbers from CSV files.

use wayfix_learn::{EmissionError, Series};

use crate::kit::{bits, says};

/// Error of reading columns of a text.
#[track_caller]
fn refused(text: impl AsRef<[u8]>, columns: &[&str], expected: &str) {
    says(Series::from_csv(text.as_ref(), columns, &[]), &format!("the input, {expected}"));
}

#[test]
fn columns_come_in_the_order_of_their_names() {
    let text = "a, b ,c\n1,2,3\n\n4,,6e1\n";
    let series = Series::from_csv(text.as_bytes(), &["c", "b"], &[]).unwrap();
    assert_eq!(series.values()[..3], [3.0, 2.0, 60.0]);
    assert!(series.values()[3].is_nan());
    assert_eq!(series.rows().iter().count(), 2);
    // Line ends, a byte order mark, quotes, and a last line without an end.
    for text in [
        "a,b,c\r\n1,2,3\r\n4,,60\r\n",
        "\u{feff}a,b,c\n1,2,3\n4,,60",
        "\"a\",\"b\",\"c\"\r\n\"1\", 2 ,3\r\n\r\n\r\n4, ,\"60\"",
        "\n\na,b,c\n1,2,\"\n3\"\n4,\"\",60\n\n",
    ] {
        let found = Series::from_csv(text.as_bytes(), &["c", "b"], &[]).unwrap();
        assert_eq!(bits(found.values()), bits(series.values()), "{text:?}");
    }
    let none = Series::from_csv("a,b\n".as_bytes(), &["b"], &[]).unwrap();
    assert_eq!(none.rows().iter().count(), 0);
    // Columns that are not read may hold anything.
    let other = Series::from_csv(&b"name,a\nZ\xfcrich,1\nnan,2\n"[..], &["a"], &[]).unwrap();
    assert_eq!(other.values(), [1.0, 2.0]);
}

#[test]
fn missing_values_may_be_written_as_texts() {
    let text = "a,b\nNA,1\n2, null \n,4\n";
    let series = Series::from_csv(text.as_bytes(), &["a", "b"], &["NA", "null"]).unwrap();
    let missing: Vec<bool> = series.values().iter().map(|value| value.is_nan()).collect();
    assert_eq!(missing, [true, false, false, true, true, false]);
    assert_eq!([series.values()[1], series.values()[2], series.values()[5]], [1.0, 2.0, 4.0]);

    refused(text, &["a"], "line 2: a is \"NA\", expected a finite number or nothing");
    says(
        Series::from_csv(text.as_bytes(), &["b"], &["NA"]),
        "the input, line 3: b is \"null\", expected a finite number, nothing or \"NA\"",
    );
    let read = |text: &str| Series::from_csv(text.as_bytes(), &["a"], &["NA", "nan"]);
    says(
        read("a\nNA\nNaN\n"),
        "the input, line 3: a is \"NaN\", expected a finite number, nothing or one of [\"NA\", \"nan\"]",
    );
    assert!(read("a\nnan\n").unwrap().values()[0].is_nan());
    // In a single column, empty lines are skipped, and an empty text in quotes is a value.
    let one = Series::from_csv("a\r\n1\r\n\r\n\"\"\r\n2\r\n".as_bytes(), &["a"], &[]).unwrap();
    assert_eq!(one.values().len(), 3);
    assert!(one.values()[1].is_nan());
}

/// No number is read as NaN or infinity.
#[test]
fn values_that_are_not_finite_are_errors() {
    for text in ["nan", "NaN", "inf", "-inf", "+Infinity", "1e999", "-1e999"] {
        let expected = format!("line 3: b is {text:?}, expected a finite number or nothing");
        refused(format!("a,b\n1,2\n3,{text}\n"), &["a", "b"], &expected);
    }
    let series = Series::from_csv("a\n1e-999\n-1.7e308\n".as_bytes(), &["a"], &[]).unwrap();
    assert_eq!(series.values(), [0.0, -1.7e308]);
}

/// The line is that of the defect, whatever precedes it.
#[test]
fn errors_name_the_line() {
    let expected =
        |line: u64| format!("line {line}: a is \"x\", expected a finite number or nothing");
    for (text, line) in [
        ("a,b\nx,3\n", 2),
        ("a,b\nx,3", 2),
        ("a,b\r\n1,2\r\nx,3\r\n", 3),
        ("a,b\r\n\r\nx,3", 3),
        ("a,b\n1,2\n\n\nx,3\n4,5\n", 5),
        ("\n\na,b\n\nx,3\n", 5),
        ("a,b\n1,\"x\ny\"\nx,4\n", 4),
        ("a,b\n1,2\nx,\"y\nz\"\n", 3),
    ] {
        refused(text, &["a"], &expected(line));
    }
    // Also far beyond one buffer.
    let long = format!("a,b\r\n{}x,1\r\n", "1.25,hello\r\n\r\n".repeat(5000));
    refused(long, &["a"], &expected(10_002));
    refused("a,b,c\n\n1,2\n", &["a"], "line 3: has 2 fields, the header has 3");
    refused("a,b\n1,2\n3\n4,5\n", &["a"], "line 3: has 1 field, the header has 2");
    refused("a,b\n1,2,3\n", &["a"], "line 2: has 3 fields, the header has 2");
    refused(
        b"a\n1\n\xff\n",
        &["a"],
        "line 3: a is \"\u{fffd}\", expected a finite number or nothing",
    );
    let digits = format!("a\n{}\n", "1_".repeat(100));
    let start = format!("line 2: a is \"{}…\", expected", "1_".repeat(30));
    let error = Series::from_csv(digits.as_bytes(), &["a"], &[]).unwrap_err();
    assert!(error.to_string().contains(&start), "{error}");
}

#[test]
fn columns_that_are_not_there_are_errors() {
    refused("a,b\n1,2\n", &["a", "c"], "line 1: there is no column c, the header is \"a, b\"");
    refused("\n\na,b\n1,2\n", &["A"], "line 3: there is no column A, the header is \"a, b\"");
    refused("a,b,a\n1,2,3\n", &["a"], "line 1: there is more than one column a");
    assert!(Series::from_csv("a,b,a\n1,2,3\n".as_bytes(), &["b"], &[]).is_ok());
    refused("a\n", &[], "line 1: no columns were asked for");
    refused("", &["a"], "line 1: the header is missing");
    let wide = format!("{}\n", vec!["column"; 1000].join(","));
    let error = Series::from_csv(wide.as_bytes(), &["a"], &[]).unwrap_err();
    assert!(error.to_string().len() < 700, "{error}");
}

#[test]
fn files_that_cannot_be_read_are_errors() {
    let error = Series::from_csv_file("no such file", &["a"], &[]).unwrap_err();
    assert!(matches!(&error, EmissionError::Read { file, .. } if file == "no such file"));
    assert!(error.to_string().starts_with("no such file cannot be read: "), "{error}");
    let error = Series::from_csv_file(env!("CARGO_MANIFEST_DIR"), &["a"], &[]).unwrap_err();
    assert!(matches!(error, EmissionError::Read { .. }), "{error}");
}
