//! Drives from files, and answers written to files.

use std::io::{Error, Read, Write};

use wayfix::map::{Position, RoadClass};
use wayfix_roads::NetworkBuilder;
use wayfix_roads::NetworkError;
use wayfix_roads::matching::{
    AnswerWriter, Matcher, Trace, TracePoint, TraceReport, read_traces, read_traces_from,
};

const HEADER: &str = "trace,time,longitude,latitude";

fn problem(text: &str) -> String {
    let error = read_traces_from("drives", text.as_bytes()).unwrap_err();
    let text = error.to_string();
    assert!(text.len() < 400, "{} bytes", text.len());
    text
}

#[test]
fn points_left_out_are_counted_for_each_drive() {
    let text = format!(
        "{HEADER}\nA,0,149,-35\nA,0,149,-35\nA,5,149,-35\nA,3,149,-35\nA,5,149,-35\nB,-0,149,-35\n\
         B,0,149,-35\nB,1,149,-35\nC,7,149,-35\nC,6,149,-35\n"
    );
    let (traces, report) = read_traces_from("drives", text.as_bytes()).unwrap();
    let of = |t: &Trace| (t.points.len(), t.repeated, t.backwards);
    let found: Vec<_> = traces.iter().map(|t| (t.name.as_str(), of(t))).collect();
    assert_eq!(found, [("A", (2, 2, 1)), ("B", (2, 1, 0)), ("C", (1, 0, 1))]);
    assert_eq!((report.repeated, report.backwards), (3, 2));
    assert_eq!(report.skipped_lines, [3, 5, 6, 8, 11]);
    let counts = "skipped 3 points of the same time and 2 that go back in time";
    assert_eq!(report.to_string(), format!("{counts} (lines 3, 5, 6, 8, 11)"));

    let text = format!("{HEADER}\n{}", "A,7,149,-35\n".repeat(30));
    let (_, report) = read_traces_from("drives", text.as_bytes()).unwrap();
    assert_eq!((report.repeated, report.backwards), (29, 0));
    assert_eq!(report.skipped_lines, [3, 4, 5, 6, 7, 8, 9, 10, 11, 12]);
    assert!(report.to_string().ends_with("(lines 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, …)"));
}

/// A file in descending order is refused rather than read as a drive of one point.
#[test]
fn descending_times_are_an_error() {
    let lines = |times: &[u32]| -> String {
        let line = |time: &u32| format!("B,{time},149.13,-35.28\n");
        times.iter().map(line).collect::<Vec<_>>().concat()
    };
    let header = "trace,time,longitude,latitude\nA,1,149.13,-35.28\n";
    let expected = "drives, line 4: 3 points of drive \"B\" from here on go back in time, expected ascending times";
    assert_eq!(problem(&format!("{header}{}", lines(&[9, 8, 7, 6]))), expected);
    // Also if another drive follows.
    let text = format!("{header}{}C,1,149.13,-35.28\n", lines(&[9, 8, 7, 6]));
    assert_eq!(problem(&text), expected);
    // A few points may be out of order.
    let text = format!("{header}{}", lines(&[1, 2, 3, 2, 4]));
    assert_eq!(read_traces_from("drive", text.as_bytes()).unwrap().0[1].points.len(), 4);
}

#[test]
fn times_may_be_dates() {
    let times = [
        "2024-05-01T12:00:00Z",
        "2024-05-01 12:00:01",
        "2024-05-01T14:00:01.5+02:00",
        "1714564802",
        "2024-05-01T07:00:03-0500",
    ];
    let lines = times.map(|time| format!("A,{time},149,-35\n"));
    let text = format!("{HEADER}\n{}", lines.concat());
    let (traces, report) = read_traces_from("drives", text.as_bytes()).unwrap();
    let seconds: Vec<f64> = traces[0].points.iter().map(|p| p.time - 1_714_564_800.0).collect();
    assert_eq!(seconds, [0.0, 1.0, 1.5, 2.0, 3.0]);
    assert_eq!(report, TraceReport::default());
    for time in ["2024-05-32T12:00:00Z", "2024-05-01", "12:00", ""] {
        assert_eq!(
            problem(&format!("{HEADER}\nA,0,149,-35\nA,{time},149,-35\n")),
            format!(
                "drives, line 3: time is {time:?}, expected seconds, or a date and time as \
                 2024-05-01T12:00:00Z"
            )
        );
    }
}

#[test]
fn columns_that_are_not_known_are_named() {
    let text = "acuracy,trace,time,longitude,latitude,time,heading\n5,A,0,149,-35,x,-90\n";
    let (traces, report) = read_traces_from("drives", text.as_bytes()).unwrap();
    let point = traces[0].points[0];
    assert_eq!((point.accuracy, point.heading), (None, Some(-90.0)));
    assert_eq!(report.ignored_columns, ["acuracy", "time"]);
    assert!(report.to_string().ends_with("\nunknown column: acuracy\nunknown column: time"));
    let text = format!("{HEADER},speed,accuracy\nA,0,149,-35,,\n");
    let (_, report) = read_traces_from("drives", text.as_bytes()).unwrap();
    assert!(report.ignored_columns.is_empty() && report.skipped_lines.is_empty());
}

#[test]
fn files_without_points() {
    let expected = "drives, line 2: there are no points, expected at least one";
    assert_eq!(problem(&format!("{HEADER}\n")), expected);
    assert!(problem("").contains("has no column trace"));
}

#[test]
fn drives_of_a_file_can_be_matched() {
    // The total order of doubles has -0 before 0, but they are the same time.
    let matcher = matcher();
    for times in ["-0,0", "0,-0", "1e18,1000000000000000001", "-1e20,1e20"] {
        let lines = times.split(',').map(|time| format!("A,{time},149.13,-35.28\n"));
        let text = format!("{HEADER}\n{}", lines.collect::<String>());
        let (traces, _) = read_traces_from("drives", text.as_bytes()).unwrap();
        matcher.match_drive(&traces[0].points).unwrap();
    }
}

#[test]
fn errors_name_the_line_in_few_words() {
    let long = "x".repeat(4_000_000);
    assert!(problem(&format!("{long},time\n")).starts_with("drives, line 1: the header \"xxx"));
    assert_eq!(
        problem(&format!("{HEADER}\nA,0,149,-35\nA,{long},149,-35\n")),
        format!(
            "drives, line 3: time is \"{}…\", expected seconds, or a date and time as \
             2024-05-01T12:00:00Z",
            &long[..60]
        )
    );
    assert!(
        problem(&format!("{HEADER}\n{long},0,149,-35\nB,0,149,-35\n{long},1,149,-35\n"))
            .starts_with("drives, line 4: points of drive \"xxx")
    );
    assert_eq!(
        problem(&format!("{HEADER}\nA,0,-35,149\n")),
        "drives, line 2: the point has latitude 149, expected a latitude from -90 to 90 degrees \
         (are longitude and latitude swapped?)"
    );
    assert_eq!(
        problem(&format!("{HEADER}\nA,0,190,-35\n")),
        "drives, line 2: the point has longitude 190, expected a longitude from -180 to 180 degrees"
    );
    for heading in ["-181", "361", "NaN"] {
        let found = problem(&format!("{HEADER},heading\nA,0,149,-35,{heading}\n"));
        assert!(found.ends_with("expected degrees from -180 to 360"), "{found}");
    }
    for (point, expected) in [
        ("A,NaN,149,-35", "the point has time NaN, expected seconds from -1e20 to 1e20"),
        ("A,1e21,149,-35", "expected seconds from -1e20 to 1e20"),
        ("A,0,NaN,-35", "the point has longitude NaN"),
        ("A,0,149,", "latitude is \"\", expected a number"),
    ] {
        let found = problem(&format!("{HEADER}\n{point}\n"));
        assert!(found.starts_with("drives, line 2: ") && found.contains(expected), "{found}");
    }
    for value in ["0", "-1", "1e300"] {
        let found = problem(&format!("{HEADER},accuracy\nA,0,149,-35,{value}\n"));
        let expected = format!("the point has accuracy {value}, expected metres from 1e-6 to 1e9");
        assert_eq!(found, format!("drives, line 2: {expected}"));
    }
}

/// Also if carriage returns end lines, and some lines are empty.
#[test]
fn lines_count_as_in_an_editor() {
    let text = format!("{HEADER}\n\nA,1,149,-35\nA,1,149,-35\n\n\nA,0,149,-35\n");
    for text in [text.clone(), text.replace('\n', "\r\n")] {
        let (_, report) = read_traces_from("drives", text.as_bytes()).unwrap();
        assert_eq!(report.skipped_lines, [4, 7]);
        let found = problem(&format!("{text}A,2,149\n"));
        let byte = text.len();
        assert_eq!(
            found,
            format!(
                "drives, line 8: CSV error: record 4 (line: 8, byte: {}): found record with 3 \
                 fields, but the previous record has 4 fields",
                // The record begins after the carriage return.
                byte - usize::from(text.contains('\r'))
            )
        );
    }
    let found = problem(&format!("\n{HEADER}\r\n"));
    assert_eq!(found, "drives, line 3: there are no points, expected at least one");
}

/// A field in quotes may span several lines.
#[test]
fn lines_count_in_fields() {
    let text = format!("{HEADER}\n\n\"A\n\nB\",1,149,-35\n\"A\n\nB\",1,149,-35\n\n\"C\nD\",1,149,");
    for text in [text.clone(), text.replace('\n', "\r\n")] {
        let (traces, report) = read_traces_from("drives", format!("{text}-35").as_bytes()).unwrap();
        assert_eq!((traces.len(), &report.skipped_lines[..]), (2, &[6][..]));
        let found = problem(&format!("{text}-95\n"));
        assert!(found.starts_with("drives, line 10: the point has latitude -95"), "{found}");
    }
}

/// File on a disk that fails.
struct Failing;

impl Read for Failing {
    fn read(&mut self, _: &mut [u8]) -> Result<usize, Error> {
        Err(Error::other("the disk is on fire"))
    }
}

impl Write for Failing {
    fn write(&mut self, _: &[u8]) -> Result<usize, Error> {
        Err(Error::other("the disk is full"))
    }

    fn flush(&mut self) -> Result<(), Error> {
        Ok(())
    }
}

#[test]
fn files_that_cannot_be_read() {
    let is_read = |error: NetworkError| matches!(error, NetworkError::Read { .. });
    assert!(is_read(read_traces("no/such/file.csv").unwrap_err()));
    // A folder opens like a file, but can't be read.
    assert!(is_read(read_traces(".").unwrap_err()));
    assert_eq!(
        read_traces_from("drives", Failing).unwrap_err().to_string(),
        "cannot read drives: the disk is on fire"
    );
}

fn matcher() -> Matcher {
    let mut builder = NetworkBuilder::new();
    for (id, longitude) in [(1, 149.13), (2, 149.14)] {
        builder.node(id, Position { latitude: -35.28, longitude }).unwrap();
    }
    builder.both_ways(1, 2, RoadClass::Street).unwrap();
    Matcher::new(builder.build().unwrap())
}

#[test]
fn writers_with_and_without_a_header() {
    let matcher = matcher();
    let at = |longitude| Position { latitude: -35.28, longitude };
    let points = [TracePoint::new(0.0, at(149.131)), TracePoint::new(20.0, at(149.133))];
    let drive = matcher.match_drive(&points).unwrap();
    let (mut routes, mut route_lines) = (Vec::new(), Vec::new());
    AnswerWriter::routes(&mut routes).with_header().unwrap().write("A", &matcher, &drive).unwrap();
    let mut writer = AnswerWriter::routes(&mut route_lines);
    writer.write("A", &matcher, &drive).unwrap();
    drop(writer);
    let header = b"trace,seq,from,to,enter_m,exit_m,off_road\n";
    assert_eq!(routes, [&header[..], &route_lines].concat());
    assert!(route_lines.starts_with(b"A,0,1,2,"));

    let (mut points, mut point_lines) = (Vec::new(), Vec::new());
    AnswerWriter::points(&mut points, 1)
        .with_header()
        .unwrap()
        .write("A", &matcher, &drive)
        .unwrap();
    let mut writer = AnswerWriter::points(&mut point_lines, 1);
    writer.write("A", &matcher, &drive).unwrap();
    drop(writer);
    let header = points.iter().position(|&byte| byte == b'\n').unwrap() + 1;
    assert!(points.starts_with(b"trace,point,time,estimator,"));
    assert_eq!(points[header..], point_lines);

    // Unwritten data is an error, however short.
    assert!(AnswerWriter::routes(Failing).with_header().is_err());
    assert!(AnswerWriter::points(Failing, 1).with_header().is_err());
    assert!(AnswerWriter::routes(Failing).write("A", &matcher, &drive).is_err());
    assert!(AnswerWriter::points(Failing, 1).write("A", &matcher, &drive).is_err());

    // The writer is returned, with its contents.
    let mut writer = AnswerWriter::routes(Vec::new());
    writer.write("A", &matcher, &drive).unwrap();
    assert_eq!(writer.into_inner().unwrap(), route_lines);
    let mut writer = AnswerWriter::points(Vec::new(), 1);
    writer.write("A", &matcher, &drive).unwrap();
    assert_eq!(writer.into_inner().unwrap(), point_lines);

    // A disk that is full when a buffer is flushed.
    let late = || std::io::BufWriter::new(Lazy);
    let mut writer = AnswerWriter::routes(late());
    assert!(writer.flush().is_err() && writer.write("A", &matcher, &drive).is_err());
    let mut writer = AnswerWriter::points(late(), 1);
    assert!(writer.flush().is_err() && writer.write("A", &matcher, &drive).is_err());
}

/// A disk that accepts everything, and is full at the end.
struct Lazy;

impl Write for Lazy {
    fn write(&mut self, bytes: &[u8]) -> Result<usize, Error> {
        Ok(bytes.len())
    }

    fn flush(&mut self) -> Result<(), Error> {
        Err(Error::other("the disk is full"))
    }
}
