//! Drives from files of each format.

use wayfix_roads::NetworkError;
use wayfix_roads::matching::read_traces_from;

use super::super::damage::damaged;
use super::{CORNERS, drives, place, refused, show};
use crate::counts::Counts;
use crate::draw::Draw;

/// Names of files, whose endings tell the format.
const NAMES: [&str; 3] = ["traces", "traces.gpx", "traces.geojson"];
const TIMES: [&str; 5] = ["", "0.5", "-0", "1e18", "1970-01-01T00:00:03.5+01:00"];

/// A point of a drive, as in a file.
struct Point {
    time: String,
    latitude: f64,
    longitude: f64,
}

pub(super) fn traces(draw: &mut Draw<'_>, counts: &mut Counts) {
    let corner = draw.pick(&CORNERS);
    let drives: Vec<Vec<Point>> = (0..=draw.below(3))
        .map(|_| (0..draw.below(6)).map(|step| point(draw, corner, step)).collect())
        .collect();
    let format = draw.below(NAMES.len());
    let text = match format {
        0 => csv(draw, &drives),
        1 => gpx(draw, &drives),
        _ => geojson(draw, &drives),
    };
    let file = damaged(draw, text.as_bytes());
    show(counts, NAMES[format], &file);
    match read_traces_from(NAMES[format], &file[..]) {
        Ok((traces, report)) => {
            counts.add("files of drives accepted");
            let sums = traces
                .iter()
                .fold([0; 2], |sum, trace| [sum[0] + trace.repeated, sum[1] + trace.backwards]);
            assert_eq!(sums, [report.repeated, report.backwards]);
            let matcher = drives::town(corner);
            for trace in &traces {
                let matched = matcher.match_drive(&trace.points);
                drives::check(&matched.expect("points that a file may have"));
                counts.add("drives of files");
            }
        }
        Err(error) => {
            if let NetworkError::Feature { feature, .. } = &error {
                assert!((1..=file.len()).contains(feature), "feature {feature}");
            }
            refused(&error, &file, counts);
        }
    }
}

fn point(draw: &mut Draw<'_>, corner: [f64; 2], step: usize) -> Point {
    let [latitude, longitude] = place(corner, draw.below(9));
    let time = draw.pick(&TIMES);
    let time = if time.is_empty() { step.to_string() } else { time.to_owned() };
    Point { time, latitude, longitude }
}

fn csv(draw: &mut Draw<'_>, drives: &[Vec<Point>]) -> String {
    let mut text = String::from("trace,time,longitude,latitude,accuracy,heading,speed\n");
    for (trace, points) in drives.iter().enumerate() {
        for Point { time, latitude, longitude } in points {
            let more = draw.pick(&[",,", "5,,", ",90,3", "1e9,-180,0"]);
            text += &format!("{trace},{time},{longitude},{latitude},{more}\n");
        }
    }
    text
}

fn gpx(draw: &mut Draw<'_>, drives: &[Vec<Point>]) -> String {
    const NAMES: [&str; 3] = ["", "<name>A &amp; B</name>", "<name>A (2)</name>"];
    const MORE: [&str; 4] = [
        "",
        "<speed>3</speed><course>90</course>",
        "<extensions><x:T><x:speed>-1</x:speed></x:T></extensions>",
        "<ele>570</ele><!-- a comment --><name><![CDATA[a point]]></name>",
    ];
    let mut text = String::from("<?xml version=\"1.0\"?>\n<gpx version=\"1.1\">\n");
    for points in drives {
        text += &format!("<trk>{}<trkseg>\n", draw.pick(&NAMES));
        for Point { time, latitude, longitude } in points {
            let more = draw.pick(&MORE);
            text += &format!(
                "<trkpt lat=\"{latitude}\" lon='{longitude}'><time>{time}</time>{more}</trkpt>\n"
            );
            text += if draw.one_in(4) { "</trkseg><trkseg>" } else { "" };
        }
        text += "</trkseg></trk>\n";
    }
    text + "</gpx>\n"
}

fn geojson(draw: &mut Draw<'_>, drives: &[Vec<Point>]) -> String {
    let feature = |properties: &str, kind: &str, coordinates: &str| {
        format!(
            r#"{{"type":"Feature","properties":{{{properties}}},"geometry":{{"type":"{kind}","coordinates":{coordinates}}}}}"#
        )
    };
    let mut features = Vec::new();
    for (trace, points) in drives.iter().enumerate() {
        let at = |point: &Point| format!("[{},{}]", point.longitude, point.latitude);
        if draw.one_in(2) {
            let [line, times] = [
                points.iter().map(at).collect::<Vec<_>>(),
                points.iter().map(|point| format!("{:?}", point.time)).collect(),
            ]
            .map(|list| format!("[{}]", list.join(",")));
            let key = draw.pick(&["coordTimes", "times"]);
            features.push(match draw.below(3) {
                0 => feature(
                    &format!("\"{key}\":[{times}]"),
                    "MultiLineString",
                    &format!("[{line}]"),
                ),
                1 => feature(&format!("\"name\":\"A\",\"{key}\":{times}"), "LineString", &line),
                _ => feature(&format!("\"{key}\":{times}"), "LineString", &line),
            });
            continue;
        }
        for point in points {
            let more = draw.pick(&["", ",\"speed\":3", ",\"accuracy\":5,\"heading\":-90"]);
            let properties = format!("\"trace\":{trace},\"time\":{:?}{more}", point.time);
            features.push(feature(&properties, "Point", &at(point)));
        }
    }
    format!(r#"{{"type":"FeatureCollection","features":[{}]}}"#, features.join(",\n"))
}
