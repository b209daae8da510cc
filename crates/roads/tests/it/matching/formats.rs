//! Drives from GPX and GeoJSON files.

use std::fmt::Write;

use wayfix_roads::NetworkError;
use wayfix_roads::matching::{Trace, TracePoint, TraceReport, read_traces, read_traces_from};

type Read = Result<(Vec<Trace>, TraceReport), NetworkError>;

fn gpx(text: &str) -> Read {
    read_traces_from("drives.gpx", text.as_bytes())
}

fn geojson(text: &str) -> Read {
    read_traces_from("drives.GeoJSON", text.as_bytes())
}

fn problem(read: Read) -> String {
    let text = read.unwrap_err().to_string();
    assert!(text.len() < 400, "{} bytes", text.len());
    text
}

/// Name and number of points of each drive.
fn counts(read: Read) -> Vec<(String, usize)> {
    read.unwrap().0.into_iter().map(|trace| (trace.name, trace.points.len())).collect()
}

fn points(read: Read) -> Vec<TracePoint> {
    read.unwrap().0.swap_remove(0).points
}

const HEAD: &str = "<?xml version=\"1.0\" encoding=\"UTF-8\"?>
<gpx version=\"1.1\" creator=\"a receiver\" xmlns=\"http://www.topografix.com/GPX/1/1\">\n";

const GPX: &str = r#"  <metadata><name>of the file</name><time>2030-01-01T00:00:00Z</time></metadata>
  <wpt lat="1" lon="2"><name>a place</name></wpt>
  <rte><name>planned</name><rtept lat="1" lon="2"/></rte>
  <trk>
    <name>Home &amp; back<![CDATA[ <1>]]></name>
    <trkseg>
      <trkpt lat="-35.28" lon="149.13"><ele>570</ele><time>2024-05-01T12:00:00Z</time></trkpt>
      <trkpt lon='149.14' lat='-35.29'>
        <!-- a comment -->
        <time> 2024-05-01T12:00:01.5Z </time>
        <extensions><gpxtpx:TrackPointExtension xmlns:gpxtpx="x">
          <gpxtpx:speed>8.5</gpxtpx:speed><gpxtpx:course>270</gpxtpx:course>
        </gpxtpx:TrackPointExtension></extensions>
      </trkpt>
      <trkpt lat="-35.28" lon="149.15"><time>2024-05-01T12:00:01.5Z</time></trkpt>
      <trkpt lat="-35.28" lon="149.15"><time>2024-05-01T12:00:03Z</time><speed>-1</speed><course>-1</course></trkpt>
    </trkseg>
    <trkseg/>
    <trkseg><trkpt lat="-35.28" lon="149.15"><time>2024-05-01T13:00:00Z</time></trkpt></trkseg>
  </trk>
  <trk><trkseg><trkpt lat="1" lon="2"><time>7</time></trkpt></trkseg></trk>
  <trk><name>Home &amp; back &#60;1></name><trkseg>
    <trkpt lat="1" lon="2"><time>7</time></trkpt></trkseg></trk>
</gpx>
"#;

#[test]
fn tracks_of_gpx() {
    let text = format!("{HEAD}{GPX}");
    let expected = [
        ("Home & back <1>", 3),
        ("Home & back <1> (2)", 1),
        ("track 2", 1),
        ("Home & back <1> (3)", 1),
    ];
    assert_eq!(counts(gpx(&text)), expected.map(|(name, count)| (name.to_owned(), count)));
    let (traces, report) = gpx(&text).unwrap();
    let start = 1_714_564_800.0;
    let [first, second, third] = traces[0].points[..] else { panic!("{traces:?}") };
    assert_eq!((first.time, first.speed, first.heading), (start, None, None));
    assert_eq!([first.position.latitude, first.position.longitude], [-35.28, 149.13]);
    assert_eq!((second.time, second.speed, second.heading), (start + 1.5, Some(8.5), Some(270.0)));
    assert_eq!([second.position.latitude, second.position.longitude], [-35.29, 149.14]);
    // Phones write -1 for "unknown".
    assert_eq!((third.time, third.speed, third.heading), (start + 3.0, None, None));
    assert_eq!((report.repeated, &report.skipped_lines[..]), (1, &[17][..]));
    // With other line ends, and a byte order mark.
    let windows = format!("\u{feff}{}", text.replace('\n', "\r\n"));
    assert_eq!(gpx(&windows).unwrap(), (traces, report));
    let path = std::path::Path::new(env!("CARGO_TARGET_TMPDIR")).join("drives.GPX");
    std::fs::write(&path, text).unwrap();
    assert_eq!(read_traces(&path).unwrap().0.len(), 4);
}

#[test]
fn errors_of_gpx_name_the_line() {
    let track = |points: &str| {
        gpx(&format!("{HEAD}<trk><name>A</name><trkseg>\n{points}\n</trkseg></trk></gpx>"))
    };
    let at = r#"lat="1" lon="2""#;
    let time = "<time>1</time>";
    for (points, expected) in [
        (format!("<trkpt {at}/>"), "4: the point has no time, expected one in each <trkpt>"),
        (
            format!("<trkpt {at}>{time}</trkpt>\n<trkpt {at}>\n</trkpt>"),
            "5: the point has no time, expected one in each <trkpt>",
        ),
        (format!("<trkpt lon=\"2\">{time}</trkpt>"), "4: the point has no lat, expected degrees"),
        (
            format!("\n<trkpt lat=\"1\" lon=\"2,5\">{time}</trkpt>"),
            "5: lon is \"2,5\", expected a number",
        ),
        (
            format!("<trkpt lat=\"149\" lon=\"-35\">{time}</trkpt>"),
            "4: the point has latitude 149, expected a latitude from -90 to 90 degrees (are \
             longitude and latitude swapped?)",
        ),
        (
            format!("<trkpt {at}>\n<time>noon</time></trkpt>"),
            "5: time is \"noon\", expected seconds, or a date and time as 2024-05-01T12:00:00Z",
        ),
        (
            format!("<trkpt {at}>{time}<speed>fast</speed></trkpt>"),
            "4: speed is \"fast\", expected a number",
        ),
        (
            format!("<trkpt {at}>{time}<course>400</course></trkpt>"),
            "4: the point has heading 400, expected degrees from -180 to 360",
        ),
        (String::new(), "5: there are no points, expected at least one"),
    ] {
        assert_eq!(problem(track(&points)), format!("drives.gpx, line {expected}"));
    }
    let back = [9, 8, 7, 6].map(|time| format!("<trkpt {at}><time>{time}</time></trkpt>\n"));
    assert_eq!(
        problem(track(&back.concat())),
        "drives.gpx, line 5: 3 points of drive \"A\" from here on go back in time, expected \
         ascending times"
    );
    let early = "the file ends too early, expected </gpx>";
    assert_eq!(problem(gpx(&format!("{HEAD}<trk>\n"))), format!("drives.gpx, line 4: {early}"));
    assert_eq!(
        problem(gpx("<kml>\n</kml>")),
        "drives.gpx, line 1: the file starts with <kml>, expected <gpx>"
    );
    for text in ["", "trace,time\n1,2"] {
        assert!(problem(gpx(text)).contains("there are no points"), "{text}");
    }
    for text in ["</trk>", "<trk></gpx>", "<trk", "<trkpt lat=\"1\" lat=\"2\">", "<a b=c/>&"] {
        let found = problem(gpx(&format!("{HEAD}\n{text}\n")));
        assert!(found.starts_with("drives.gpx, line "), "{text}: {found}");
    }
    let bytes = [HEAD.as_bytes(), b"\xff\xfe"].concat();
    let error = read_traces_from("drives.gpx", &bytes[..]).unwrap_err();
    assert!(matches!(error, NetworkError::Read { .. }), "{error}");
    let long = "x".repeat(1_000_000);
    problem(track(&format!("<trkpt {at}><time>{long}</time></trkpt>")));
    problem(track(&format!("<trkpt lat=\"{long}\" lon=\"1\"/>")));
    problem(gpx(&format!("<{long}/>")));
    problem(gpx(&format!("{HEAD}<{long}></{long}y>")));
}

/// A truncated file is an error or, if it ends with an element, a valid file.
#[test]
fn gpx_that_was_cut() {
    let text = format!("{HEAD}{GPX}");
    for end in 0..text.trim_end().len() {
        let found = gpx(&text[..end]).unwrap_err().to_string();
        assert!(found.starts_with("drives.gpx, line "), "{end}: {found}");
    }
}

#[test]
fn names_that_meet() {
    let mut text = HEAD.to_owned();
    for name in ["A", "A (2)", "A", "A", "A (2)"] {
        let point = r#"<trkpt lat="1" lon="2"><time>7</time></trkpt>"#;
        let _ = write!(text, "<trk><name>{name}</name><trkseg>{point}</trkseg></trk>");
    }
    let names = counts(gpx(&format!("{text}</gpx>"))).into_iter().map(|(name, _)| name);
    let names: Vec<String> = names.collect();
    assert_eq!(names, ["A", "A (2)", "A (3)", "A (4)", "A (2) (2)"]);
}

fn feature(properties: &str, kind: &str, coordinates: &str) -> String {
    format!(
        r#"{{"type":"Feature","properties":{{{properties}}},"geometry":{{"type":"{kind}","coordinates":{coordinates}}}}}"#
    )
}

fn collection(features: &[String]) -> Read {
    let features = features.join(",\n");
    geojson(&format!(r#"{{"type":"FeatureCollection","features":[{features}]}}"#))
}

const LINE: &str = "[[149.13,-35.28],[149.14,-35.28,570]]";
const TIMES: &str = r#"["2024-05-01T12:00:00Z", 1714564805]"#;

#[test]
fn lines_of_geojson() {
    let line = |properties: &str| feature(properties, "LineString", LINE);
    let lines = [
        line(&format!(r#""name":"A","coordTimes":{TIMES}"#)),
        line(&format!(r#""trace":7,"times":{TIMES}"#)),
        line(&format!(r#""coordinateProperties":{{"times":{TIMES}}}"#)),
        feature(
            &format!(r#""name":"A","coordTimes":[{TIMES},{TIMES}]"#),
            "MultiLineString",
            &format!("[{LINE},{LINE}]"),
        ),
    ];
    let expected = [("A", 2), ("7", 2), ("3", 2), ("A (2)", 2), ("A (3)", 2)];
    assert_eq!(counts(collection(&lines)), expected.map(|(name, count)| (name.to_owned(), count)));
    let one = points(geojson(&lines[0]));
    let found = one.iter().map(|point| [point.time, point.position.longitude]);
    let start = 1_714_564_800.0;
    assert_eq!(found.collect::<Vec<_>>(), [[start, 149.13], [start + 5.0, 149.14]]);
}

#[test]
fn points_of_geojson() {
    let point = |properties: &str| feature(properties, "Point", "[149.13,-35.28]");
    let all = [
        point(r#""time":"2024-05-01T12:00:00Z","accuracy":5,"heading":90,"speed":"3.5""#),
        point(r#""timestamp":"1714564801","name":"a stop","course":null"#),
        point(r#""time":1714564801"#),
        point(r#""time":1714564801,"trace":"B""#),
    ];
    let expected = [("1", 2), ("B", 1)];
    assert_eq!(counts(collection(&all)), expected.map(|(name, count)| (name.to_owned(), count)));
    let first = points(collection(&all))[0];
    assert_eq!((first.accuracy, first.heading, first.speed), (Some(5.0), Some(90.0), Some(3.5)));
    let (_, report) = collection(&all).unwrap();
    assert_eq!((report.repeated, report.skipped_lines.len()), (1, 0));
}

#[test]
fn errors_of_geojson_name_the_feature() {
    let good = feature(&format!(r#""times":{TIMES}"#), "LineString", LINE);
    for (properties, kind, coordinates, expected) in [
        ("", "LineString", LINE, "the line has no times, expected a property coordTimes or times"),
        (r#""times":[1,2,3]"#, "LineString", LINE, "3 times for 2 points, expected one for each"),
        (
            r#""times":5"#,
            "LineString",
            LINE,
            "the times are not a list, expected one for each point",
        ),
        (
            r#""times":[1,"noon"]"#,
            "LineString",
            LINE,
            "point 2: time is \"noon\", expected seconds, or a date and time as 2024-05-01T12:00:00Z",
        ),
        (
            r#""times":[1,[]]"#,
            "LineString",
            LINE,
            "point 2: time is \"[]\", expected seconds, or a date and time as 2024-05-01T12:00:00Z",
        ),
        (
            r#""times":[[1,2],3]"#,
            "MultiLineString",
            "[[[1,2],[1,3]],[[1,2],[1,3]]]",
            "line 2: expected a list of times for each line",
        ),
        (
            r#""times":[1,2]"#,
            "LineString",
            "[[1,2],[-35,149]]",
            "point 2: the point has latitude 149, expected a latitude from -90 to 90 degrees (are \
             longitude and latitude swapped?)",
        ),
        ("", "Point", "[1,2]", "the point has no time, expected a property time"),
        (r#""time":1,"speed":"fast""#, "Point", "[1,2]", "speed is \"fast\", expected a number"),
        (
            r#""time":1,"accuracy":-1"#,
            "Point",
            "[1,2]",
            "the point has accuracy -1, expected metres from 1e-6 to 1e9",
        ),
        (
            "",
            "Polygon",
            "[[[1,2],[1,3],[2,3],[1,2]]]",
            "the geometry is a Polygon, expected a LineString or a Point",
        ),
    ] {
        let found = problem(collection(&[good.clone(), feature(properties, kind, coordinates)]));
        assert_eq!(found, format!("drives.GeoJSON, feature 2: {expected}"));
    }
    let backwards = feature(r#""times":[9,8,7]"#, "LineString", "[[1,2],[1,3],[1,4]]");
    let found = problem(collection(&[good.clone(), backwards]));
    assert!(found.starts_with("drives.GeoJSON, feature 2: 2 points of drive \"2\""), "{found}");
    assert_eq!(
        problem(collection(&[])),
        "drives.GeoJSON, feature 1: there are no points, expected at least one"
    );
    let point = |trace: &str| feature(&format!(r#""time":1,"trace":"{trace}""#), "Point", "[1,2]");
    assert_eq!(
        problem(collection(&[point("A"), point("B"), point("A")])),
        "drives.GeoJSON, feature 3: points of drive \"A\" are apart, expected them together"
    );
    for text in ["{\n]".to_owned(), format!("\n{}", feature(r#""time":1"#, "Point", "[1]"))] {
        assert!(problem(geojson(&text)).starts_with("drives.GeoJSON, line 2: "));
    }
    assert!(problem(geojson(r#"{"type":"Point","coordinates":[1,2]}"#)).contains("feature 1: "));
    let long = "x".repeat(1_000_000);
    problem(collection(&[feature(&format!(r#""time":"{long}""#), "Point", "[1,2]")]));
    problem(collection(&[feature(&format!(r#""time":["{long}"]"#), "Point", "[1,2]")]));
    problem(collection(&[feature(&format!(r#""time":1,"speed":"{long}""#), "Point", "[1,2]")]));
}
