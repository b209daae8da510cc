//! The same city from each format.

use std::fs;
use std::path::Path;

use wayfix::map::{Position, RoadClass};
use wayfix_roads::{Cleaning, EdgeOptions, ImportNote, ImportOptions, NetworkBuilder, RoadNetwork};

use super::pbf::Extract;
use super::{Read, csv, ends, geojson, osm};

/// Three roads: 1 - 2 - 3 main at 60 km/h, 2 → 4 one-way street, 3 - 4 - 1 collector.
fn as_extract() -> Extract<'static> {
    let primary = &[("highway", "primary"), ("maxspeed", "60")][..];
    let street = &[("oneway", "yes"), ("highway", "residential")][..];
    let collector = &[("highway", "tertiary_link")][..];
    let nodes = vec![
        (1, -352_800_000, 1_491_200_000),
        (2, -352_800_000, 1_491_300_000),
        (3, -352_800_000, 1_491_400_000),
        (4, -352_900_000, 1_491_300_000),
    ];
    let ways =
        vec![(10, &[1, 2, 3][..], primary), (11, &[2, 4], street), (12, &[3, 4, 1], collector)];
    Extract { nodes, ways, ..Extract::default() }
}

const NODES: &str = "name,id,longitude,latitude
A,1,149.12,-35.28\nB,2,149.13,-35.28\nC,3,149.14,-35.28\nD,4,149.13,-35.29\n";
const EDGES: &str = "to,from,oneway,class,speed_kmh
2,1,no,main,60\n3,2,,3,60\n4,2,yes,,\n4,3,no,collector,\n4,1,0,1,\n";

const FEATURES: &str = r#"{"type": "FeatureCollection", "features": [
{"type": "Feature", "properties": {"highway": "primary", "maxspeed": 60},
 "geometry": {"type": "LineString", "coordinates": [[149.12, -35.28], [149.13, -35.28, 570], [149.14, -35.28]]}},
{"type": "Feature", "properties": {"class": "street", "oneway": true},
 "geometry": {"type": "MultiLineString", "coordinates": [[[149.13, -35.28], [149.13, -35.29]]]}},
{"type": "Feature", "properties": {"class": 1, "name": null}, "geometry": {"type": "GeometryCollection", "geometries": [
 {"type": "LineString", "coordinates": [[149.14, -35.28], [149.13, -35.29], [149.12, -35.28]]},
 {"type": "Point", "coordinates": [149.14, -35.28]}]}}
]}"#;

/// Properties of the edges that do not depend on ids and the order of nodes.
fn edges(read: Read) -> Vec<String> {
    let network = read.unwrap().0;
    let edge = |e: usize| {
        let edge = network.edges()[e];
        let back = network.reverse(e).is_some();
        let shape = network.shape(e);
        let Position { latitude, longitude } = shape[0];
        let speed = edge.speed.map(|speed| (speed * 1e6).round());
        let (class, metres) = (edge.class, (edge.metres * 1e6).round());
        format!("{latitude} {longitude} {shape:?} {class} {metres} {speed:?} {back}")
    };
    let mut edges: Vec<String> = (0..network.edges().len()).map(edge).collect();
    edges.sort_unstable();
    edges
}

#[test]
fn all_formats_give_the_same_network() {
    let expected = edges(csv(NODES, EDGES));
    assert_eq!(expected.len(), 9);
    let mut extract = as_extract();
    assert_eq!(edges(osm(&extract.bytes())), expected);
    extract.plain_nodes = true;
    assert_eq!(edges(osm(&extract.bytes())), expected);
    extract.zlib = true;
    assert_eq!(edges(osm(&extract.bytes())), expected);
    assert_eq!(edges(geojson(FEATURES)), expected);
    assert_eq!(geojson(FEATURES).unwrap().1.count(ImportNote::OtherGeometry), 1);
    let names = csv(NODES, EDGES).unwrap().0.to_map().unwrap();
    assert!(names.places().iter().map(|place| place.name.as_str()).eq(["A", "B", "C", "D"]));
    let text = geojson(FEATURES).unwrap().0.to_geojson();
    assert_eq!(edges(geojson(&text)), expected);
}

#[test]
fn a_path_leads_to_each_format() {
    let folder = Path::new(env!("CARGO_TARGET_TMPDIR")).join("road_import");
    let named = folder.join("city");
    fs::create_dir_all(&named).unwrap();
    let options = ImportOptions::default();
    let from = |path: &Path| RoadNetwork::from_path(path, &options);
    let missing = from(&named.join("none")).unwrap_err().to_string();
    assert!(missing.ends_with("a .geojson, or a .osm.pbf"), "{missing}");
    let _ = fs::remove_file(named.join("edges.csv"));
    fs::write(named.join("nodes.csv"), NODES).unwrap();
    let half = from(&named).unwrap_err().to_string();
    assert!(half.ends_with("or places.csv and roads.csv"), "{half}");
    fs::write(named.join("edges.csv"), EDGES).unwrap();
    fs::write(folder.join("a.geojson"), FEATURES).unwrap();
    fs::write(folder.join("a.osm.pbf"), as_extract().bytes()).unwrap();
    for path in [named.clone(), folder.join("a.geojson"), folder.join("a.osm.pbf")] {
        assert_eq!(edges(from(&path)), edges(csv(NODES, EDGES)));
    }
    fs::write(named.join("edges.csv"), "from,to\n1,9\n").unwrap();
    let error = from(&named).unwrap_err().to_string();
    assert!(error.contains("edges.csv, line 2: ") && error.contains("needs place 9"), "{error}");
}

#[test]
fn cleaning_comes_with_the_import() {
    // 2 → 4 is one-way, so that 4 stays with its three neighbours.
    let cleaning = vec![Cleaning::LargestComponent, Cleaning::Contraction];
    let options = ImportOptions::default().with_cleaning(cleaning);
    let nodes = format!("{NODES}E,5,149.15,-35.28\n");
    let edges = format!("{EDGES}5,3,yes,main,60\n");
    let read = RoadNetwork::from_csv(nodes.as_bytes(), edges.as_bytes(), &options);
    let (network, report) = read.unwrap();
    assert_eq!(
        report.to_string(),
        "read 5 nodes, 10 edges\nlargest part: 5 → 4 nodes, 10 → 9 edges\n\
         contracted: 4 → 4 nodes, 9 → 9 edges"
    );
    assert_eq!(ends(&network), ends(&csv(NODES, EDGES).unwrap().0));
}

#[test]
fn lengths_loops_and_parallel_edges() {
    let nodes = "node,lon,lat\n1,149.12,-35.28\n2,149.13,-35.28\n3,149.13,-35.28\n";
    let edges = "from,to,class,length_m,lanes\n1,2,0,0.0,2\n1,2,2,950,2\n2,3,0,,1\n1,1,0,70,1\n1,1,0,0,1\n2,2,0,,1\n";
    let (network, report) = csv(nodes, edges).unwrap();
    assert_eq!(ends(&network), [[1, 1], [1, 2], [1, 2], [2, 3]]);
    assert_eq!(network.edges()[network.edge_between(0, 0).unwrap()].metres, 70.0);
    assert_eq!(network.edges()[network.edge_between(1, 2).unwrap()].metres, 0.1);
    let short = network.edges()[network.edge_between(0, 1).unwrap()];
    assert_eq!((short.metres.round(), short.class), (908.0, RoadClass::Street));
    let notes = [
        (ImportNote::LoopWithoutLength, 2),
        (ImportNote::ZeroLength, 1),
        (ImportNote::ShortLine, 1),
    ];
    assert!(report.notes().eq(notes), "{report}");
    assert_eq!(report.ignored_columns, ["lanes in edges"]);
}

/// Edges between nodes at one position are read back as loops, and all edges with their lengths.
#[test]
fn written_lengths_are_read_to_the_bit() {
    let place = Position { latitude: -35.28, longitude: 149.12 };
    let near = Position { longitude: 149.120_000_3, ..place };
    let far = Position { longitude: 149.13, ..place };
    let lines = [vec![], vec![place], vec![place, place], vec![near], vec![far, place, near]];
    for (between, end) in lines.iter().flat_map(|line| [place, near, far].map(|end| (line, end))) {
        for metres in [1e-12, 0.05, 0.1, 1.0 / 3.0, 917.3, 1e12] {
            let mut builder = NetworkBuilder::new();
            builder.node(1, place).unwrap();
            builder.node(2, end).unwrap();
            let options =
                EdgeOptions::of(RoadClass::Main).with_metres(metres).with_between(between.clone());
            builder.edge(1, 2, options).unwrap();
            let text = builder.build().unwrap().to_geojson();
            let (again, report) = geojson(&text).unwrap_or_else(|error| panic!("{error}: {text}"));
            assert_eq!(report.notes().len(), 0, "{report}: {text}");
            let total: f64 = again.edges().iter().map(|edge| edge.metres).sum();
            assert!((total / metres - 1.0).abs() < 1e-12, "{total}: {text}");
            if let [edge] = again.edges() {
                assert_eq!(edge.metres, metres, "{text}");
            }
        }
    }
}
