//! Road networks, drives and vehicles.

mod drives;
mod networks;
#[path = "../../../../crates/roads/tests/it/road_import/pbf.rs"]
mod pbf;
mod traces;
mod vehicles;

use std::io::Cursor;

use wayfix_roads::{ImportOptions, ImportReport, NetworkError, RoadNetwork};

use super::{check_message, damage::damaged};
use crate::counts::Counts;
use crate::draw::Draw;

/// Reads damaged files or bytes of roads, drives or vehicles; the first byte chooses which.
pub fn roads(bytes: &[u8], counts: &mut Counts) {
    let mut draw = Draw::new(bytes);
    match draw.below(7) {
        0 => traces::traces(&mut draw, counts),
        1 => csv(&mut draw, ["node,lon,lat", "from,to,class,length_m,oneway,speed_kmh"], counts),
        2 => csv(&mut draw, ["id,latitude,longitude,name", "from,to,class,length_m"], counts),
        3 => geojson(&mut draw, counts),
        4 => extract(&mut draw, counts),
        5 => vehicles::vehicle(&mut draw, counts),
        _ => drives::any_points(&mut draw, counts),
    }
}

/// Coordinates of towns, in degrees from their corners: also at a pole, and on both sides of the
/// antimeridian.
const CORNERS: [[f64; 2]; 4] = [[-35.3, 149.1], [89.995, 10.0], [0.0, 179.9985], [-0.001, -0.001]];
const CLASSES: [&str; 6] = ["main", "arterial", "collector", "street", "", "2"];
const METRES: [&str; 8] = ["1", "250.5", "1e-3", "1e5", "", "0", "1e-300", "1e300"];

/// Latitude and longitude of the grid point with this number.
fn place([latitude, longitude]: [f64; 2], number: usize) -> [f64; 2] {
    let east = longitude + 1e-3 * (number % 3) as f64;
    [latitude + 1e-3 * (number / 3) as f64, if east > 180.0 { east - 360.0 } else { east }]
}

fn show(counts: &Counts, what: &str, bytes: &[u8]) {
    counts.note(|| format!("{what}:\n{}", String::from_utf8_lossy(bytes)));
}

fn csv(draw: &mut Draw<'_>, headers: [&str; 2], counts: &mut Counts) {
    let (corner, count) = (draw.pick(&CORNERS), 1 + draw.below(9));
    let mut nodes = format!("{}\n", headers[0]);
    for id in 0..count {
        let [latitude, longitude] = place(corner, id);
        let id = id * 3;
        nodes += &match headers[0] {
            "node,lon,lat" => format!("{id},{longitude},{latitude}\n"),
            _ => format!("{id},{latitude},{longitude},\n"),
        };
    }
    let mut edges = format!("{}\n", headers[1]);
    for _ in 0..draw.below(20) {
        let [from, to] = [draw.below(count) * 3, draw.below(count) * 3];
        let (class, metres) = (draw.pick(&CLASSES), draw.pick(&METRES));
        edges += &format!("{from},{to},{class},{metres}");
        if headers[1].ends_with("kmh") {
            edges += draw.pick(&[",,", ",no,50", ",yes,", ",-1,30 mph", ",0,walk", ",,1e300"]);
        }
        edges.push('\n');
    }
    let which = draw.below(4);
    let mut change = |text: &str, stays: bool| {
        if stays { text.as_bytes().to_vec() } else { damaged(draw, text.as_bytes()) }
    };
    let (nodes, edges) = (change(&nodes, which == 0), change(&edges, which == 1));
    show(counts, "nodes", &nodes);
    show(counts, "edges", &edges);
    let read = RoadNetwork::from_csv(&nodes[..], &edges[..], &ImportOptions::default());
    let longest = if nodes.len() > edges.len() { &nodes } else { &edges };
    check(read, longest, draw, counts);
}

fn geojson(draw: &mut Draw<'_>, counts: &mut Counts) {
    let corner = draw.pick(&CORNERS);
    let mut features = Vec::new();
    for _ in 0..draw.below(6) {
        let line: Vec<String> = (0..draw.below(5))
            .map(|_| place(corner, draw.below(9)))
            .map(|[latitude, longitude]| format!("[{longitude},{latitude}]"))
            .collect();
        let line = format!("[{}]", line.join(","));
        let geometry = match draw.below(8) {
            0 => String::from("null"),
            1 => format!(r#"{{"type":"MultiLineString","coordinates":[{line},{line}]}}"#),
            2 => String::from(r#"{"type":"Point","coordinates":[1,2]}"#),
            3 => format!(
                r#"{{"type":"GeometryCollection","geometries":[{{"type":"LineString","coordinates":{line}}}]}}"#
            ),
            _ => format!(r#"{{"type":"LineString","coordinates":{line}}}"#),
        };
        let properties = draw.pick(&[
            "null",
            r#"{"class":"main","oneway":"yes"}"#,
            r#"{"highway":"primary","maxspeed":60,"oneway":"-1"}"#,
            r#"{"highway":"residential","speed_kmh":"fast"}"#,
            r#"{"length_m":120.5,"speed_kmh":50}"#,
            r#"{"length_m":1e11,"speed_kmh":1e300,"junction":"roundabout"}"#,
            r#"{"length_m":"0","oneway":false}"#,
        ]);
        features.push(format!(
            r#"{{"type":"Feature","properties":{properties},"geometry":{geometry}}}"#
        ));
    }
    let text = format!(r#"{{"type":"FeatureCollection","features":[{}]}}"#, features.join(",\n"));
    let file = damaged(draw, text.as_bytes());
    show(counts, "features", &file);
    let read = RoadNetwork::from_geojson(&file[..], &ImportOptions::default());
    check(read, &file, draw, counts);
}

fn extract(draw: &mut Draw<'_>, counts: &mut Counts) {
    const REFS: [&[i64]; 6] =
        [&[0, 1, 2], &[2, 5, 8, 7], &[0, 3, 4, 0], &[1, 4, 9], &[4, 4], &[7, 4, 1]];
    const TAGS: [pbf::Tags<'_>; 4] = [
        &[("highway", "primary"), ("maxspeed", "50")],
        &[("highway", "residential"), ("oneway", "yes")],
        &[("highway", "service"), ("access", "private")],
        &[("junction", "roundabout"), ("highway", "tertiary")],
    ];
    let corner = draw.pick(&CORNERS);
    let node = |id: usize| {
        let [latitude, longitude] = place(corner, id).map(|degrees| (1e7 * degrees) as i64);
        (id.cast_signed() as i64, latitude, longitude)
    };
    let ways = 0..draw.below(6);
    let file = pbf::Extract {
        nodes: (0..draw.below(10)).map(node).collect(),
        ways: ways
            .map(|id| (id.cast_signed() as i64, draw.pick(&REFS), draw.pick(&TAGS)))
            .collect(),
        relations: vec![(
            draw.pick(&[
                &[("type", "restriction"), ("restriction", "no_left_turn")][..],
                &[("type", "restriction"), ("restriction", "only_straight_on")],
                &[("type", "route")],
            ]),
            vec![("from", 1, 0), ("via", draw.pick(&[0, 0, 0, 1, 2]), 1), ("to", 1, 1)],
        )],
        plain_nodes: draw.one_in(3),
        zlib: draw.one_in(3),
    };
    let file = damaged(draw, &file.bytes());
    counts.note(|| format!("extract: {file:?}"));
    check(
        RoadNetwork::from_osm(Cursor::new(&file), &ImportOptions::default()),
        &file,
        draw,
        counts,
    );
}

/// Checks a network and its report, or an error.
fn check(
    read: Result<(RoadNetwork, ImportReport), NetworkError>,
    file: &[u8],
    draw: &mut Draw<'_>,
    counts: &mut Counts,
) {
    match read {
        Ok((network, report)) => {
            counts.add("networks accepted");
            assert_eq!(
                [report.nodes, report.edges],
                [network.nodes().len(), network.edges().len()]
            );
            networks::check(&network);
            networks::clean(network, draw, counts);
        }
        Err(error) => refused(&error, file, counts),
    }
}

fn refused(error: &NetworkError, file: &[u8], counts: &mut Counts) {
    counts.add("files refused");
    counts.note(|| error.to_string());
    check_message(error);
    if let NetworkError::Line { line, .. } = error {
        let lines = file.len() as u64 + 1;
        assert!((1..=lines).contains(line), "line {line} of at most {lines}");
    }
}
