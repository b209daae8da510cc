//! Files that are not networks.

use wayfix::map::{MapError, Position, RoadMap};
use wayfix_roads::{Cleaning, ImportNote, ImportOptions, NetworkError, RoadNetwork};

use super::pbf::{Extract, blob, header, stored};
use super::{Read, csv, geojson, osm};

const NODES: &str = "node,lat,lon\n1,-35.28,149.12\n2,-35.28,149.13\n";

fn says(read: Read, expected: &str) {
    assert_eq!(read.unwrap_err().to_string(), expected);
}

#[test]
fn csv_errors_name_file_and_line() {
    says(
        csv("node,lat,lon\n1,149.12,-35.28\n", "from,to\n"),
        "nodes, line 2: latitude 149.12 and longitude -35.28 seem to be swapped, expected degrees \
         from -90 to 90 for the latitude",
    );
    says(
        csv("node,lat,lon\n1,1000,-35.28\n", "from,to\n"),
        "nodes, line 2: latitude is 1000, expected degrees from -90 to 90",
    );
    says(
        csv("node,lat,lon\n1,NaN,200\n", "from,to\n"),
        "nodes, line 2: latitude is NaN, expected degrees from -90 to 90",
    );
    says(csv(&format!("{NODES}1,0,0\n"), "from,to\n"), "nodes, line 4: place 1 is given twice");
    says(
        csv("id,lat\n", "from,to\n"),
        "nodes, line 1: no column lon or longitude in the header \"id,lat\"",
    );
    says(csv("", "from,to\n"), "nodes, line 1: no column node or id in the header \"\"");
    says(csv("id,lat,lon\n", "from,to\n"), "a map needs at least one place, found none");
    for (row, problem) in [
        ("1", "1 columns, expected 6 as in the header"),
        ("1,3,,,,", "the road from place 1 to place 3 needs place 3, which does not exist"),
        ("-1,2,,,,", "from is \"-1\", expected a whole number from 0"),
        ("1,2,path,,,", "class \"path\", expected main, arterial, collector or street, or 0 to 3"),
        ("1,2,,-5,,", "the road from place 1 to place 2 has length -5, expected metres above 0"),
        (
            "1,2,,inf,,",
            "the road from place 1 to place 2 has length inf, expected metres above 0 and at most 1e12",
        ),
        ("1,2,,long,,", "length_m is \"long\", expected a number"),
        ("1,2,,,perhaps,", "oneway is \"perhaps\", expected yes, no or -1"),
    ] {
        let edges = format!("from,to,class,length_m,oneway,speed_kmh\n2,1,,,,\n{row}\n");
        says(csv(NODES, &edges), &format!("edges, line 3: {problem}"));
    }
}

#[test]
fn csv_errors_name_the_line_whatever_ends_it() {
    for (ending, empty) in [("\n", 0), ("\r\n", 0), ("\n\n", 1), ("\r\n\r\n", 1)] {
        let edges = "from,to\n2,1\n1,2,3\n".replace('\n', ending);
        says(
            csv(&NODES.replace('\n', ending), &edges),
            &format!("edges, line {}: 3 columns, expected 2 as in the header", 3 + 2 * empty),
        );
    }
}

#[test]
fn csv_errors_name_the_line_after_fields_of_several() {
    let nodes = "id,lat,lon,name\n\n1,2,3,\"a\n\nb\"\n2,2,4,c\n3,2,x,d\n";
    let places = "id,latitude,longitude,name\n\n1,2,3,\"a\n\nb\"\n2,2,4,c\n3,2,x,d\n";
    for ending in ["\n", "\r\n"] {
        let [nodes, places] = [nodes, places].map(|text| text.replace('\n', ending));
        says(csv(&nodes, "from,to\n"), "nodes, line 7: lon is \"x\", expected a number");
        let map =
            RoadMap::<Position>::from_csv(places.as_bytes(), &b"from,to,class,length_m\n"[..]);
        let text = map.unwrap_err().to_string();
        assert_eq!(text, "places, line 7: longitude is \"x\", expected a number");
    }
}

#[test]
fn geojson_errors_name_line_or_feature() {
    let error = geojson("{\"type\": \"FeatureCollection\",\n\"features\": [\n").unwrap_err();
    assert!(matches!(error, NetworkError::Line { line: 3 | 2, .. }), "{error}");
    assert!(geojson("<osm/>").unwrap_err().to_string().starts_with("features, line 1: "));
    let feature = |properties: &str, line: &str| {
        geojson(&format!(
            r#"{{"type": "FeatureCollection", "features": [{{"type": "Feature", "properties": null, "geometry": null}},
            {{"type": "Feature", "properties": {{{properties}}}, "geometry": {{"type": "LineString", "coordinates": {line}}}}}]}}"#
        ))
    };
    let line = "[[149.12, -35.28], [149.13, -35.28]]";
    assert_eq!(feature("", line).unwrap().0.edges().len(), 2);
    for (properties, line, problem) in [
        (
            "",
            "[[-35.28, 149.12], [-35.28, 149.13]]",
            "latitude 149.12 and longitude -35.28 seem to be swapped, expected degrees from -90 to 90 for the latitude",
        ),
        (
            "",
            "[[149.12, -35.28], [1e300, 0]]",
            "longitude is 1e300, expected degrees from -180 to 180",
        ),
        ("", "[[149.12], [1, 0]]", "1 coordinates, expected longitude and latitude"),
        (
            r#""class": "path""#,
            line,
            "class \"path\", expected main, arterial, collector or street, or 0 to 3",
        ),
        (r#""oneway": "perhaps""#, line, "oneway is \"perhaps\", expected yes, no or -1"),
        (r#""length_m": -1"#, line, "length_m is \"-1\", expected metres from 0 to 1e12"),
        (r#""length_m": "1e13""#, line, "length_m is \"1e13\", expected metres from 0 to 1e12"),
    ] {
        let error = feature(properties, line).unwrap_err().to_string();
        assert_eq!(error, format!("features, feature 2: {problem}"));
    }
    says(feature("", "[]"), "a map needs at least one place, found none");
}

#[test]
fn messages_are_short() {
    let long = "x".repeat(10_000_000);
    let feature = |properties: String| {
        format!(
            r#"{{"type": "Feature", "properties": {{{properties}}}, "geometry": {{"type": "LineString", "coordinates": [[1, 2], [3, 4]]}}}}"#
        )
    };
    for text in [
        feature(format!(r#""class": "{long}""#)),
        feature(format!(r#""oneway": "{long}""#)),
        feature(format!(r#""length_m": "{long}""#)),
        format!(r#"{{"type": "{long}"}}"#),
    ] {
        let text = geojson(&text).unwrap_err().to_string();
        assert!(text.starts_with("features, ") && text.len() < 1000, "{} bytes", text.len());
    }
    for text in [
        csv(&long, "from,to\n"),
        csv(NODES, &format!("from,to\n{long},2\n")),
        csv(NODES, &format!("from,to,class\n1,2,{long}\n")),
        csv(NODES, &format!("from,to,oneway\n1,2,{long}\n")),
        csv("id,lat,lon\n1,1e300,2\n", "from,to\n"),
        csv("id,lat,lon\n1,1e-300,149\n2,1e-300,200\n", "from,to\n"),
        csv(NODES, "from,to,length_m\n1,2,-1e300\n"),
        geojson(&feature(format!(r#""length_m": -{}"#, "9".repeat(300)))),
        osm(&header(&[&long[..60_000]])),
    ] {
        let text = text.unwrap_err().to_string();
        assert!(text.len() < 250, "{} bytes", text.len());
    }
}

#[test]
fn what_is_not_taken_is_counted() {
    let text = r#"{"type": "FeatureCollection", "features": [
        {"type": "Feature", "properties": {"highway": "primary", "speed_kmh": "fast"}, "geometry":
          {"type": "LineString", "coordinates": [[1, 2], [3, 4]]}},
        {"type": "Feature", "properties": {"speed_kmh": 1e300}, "geometry":
          {"type": "LineString", "coordinates": [[1, 2], [3, 5]]}},
        {"type": "Feature", "properties": null, "geometry": null}]}"#;
    let (network, report) = geojson(text).unwrap();
    assert!(network.edges().iter().all(|edge| edge.speed.is_none()));
    assert_eq!(report.count(ImportNote::UnknownSpeed), 2);
    assert_eq!(report.count(ImportNote::OtherGeometry), 1);
}

#[test]
fn a_file_that_cannot_be_read() {
    let options = ImportOptions::default();
    let is_read = |read: Read| matches!(read, Err(NetworkError::Read { .. }));
    // A folder opens like a file, but can't be read.
    assert!(is_read(RoadNetwork::from_csv_files(".", ".", &options)));
    assert!(is_read(RoadNetwork::from_geojson_file(".", &options)));
    let map = wayfix::map::RoadMap::<Position>::from_csv_files(".", ".");
    assert!(matches!(map, Err(MapError::Read { .. })));
}

#[test]
fn blocks_that_claim_more_than_there_is() {
    let claims = |length: [u8; 10], data: &[u8]| {
        let head = [&[10, 7][..], b"OSMData", &[24], &length].concat();
        let start = header(&["OsmSchema-V0.6"]);
        [&start[..], &(head.len() as u32).to_be_bytes(), &head, data].concat()
    };
    // The length as a varint: −1, and 2 GiB less 1, padded to ten bytes.
    let minus_one = [255, 255, 255, 255, 255, 255, 255, 255, 255, 1];
    let gigabytes = [255, 255, 255, 255, 135, 128, 128, 128, 128, 0];
    for length in [minus_one, gigabytes] {
        // No data, data of 4 GiB less 1, and compressed data of the same size.
        for data in [&[][..], &[10, 255, 255, 255, 255, 15], &[26, 255, 255, 255, 255, 15]] {
            let result = osm(&claims(length, data));
            assert!(matches!(result, Err(NetworkError::Block { block: 2, .. })), "{result:?}");
        }
    }
}

/// No contents of a block lead to a panic, or to a network of numbers that wrapped around.
#[test]
fn blocks_with_wrong_contents() {
    let data = |field: u64, data: &[u8]| {
        let bytes = [header(&["OsmSchema-V0.6"]), blob("OSMData", field, data)].concat();
        let error = osm(&bytes).unwrap_err().to_string();
        error.split_once(": ").unwrap().1.to_owned()
    };
    // The largest number, which is −2^63 as a signed one.
    let most = [255, 255, 255, 255, 255, 255, 255, 255, 255, 1];
    let string = [&[10, 9, 10, 7][..], b"highway"].concat();
    let group = |element: u8, message: &[u8]| {
        let length = |more: usize| u8::try_from(message.len() + more).unwrap();
        [&[18, length(2), element, length(0)][..], message].concat()
    };
    let way = |message: &[u8]| data(1, &[&string[..], &group(26, message)].concat());
    let tags = [&[10, 19, 10, 4][..], b"type", &[10, 11], b"restriction"].concat();
    let relation = group(34, &[18, 1, 0, 26, 1, 1, 66, 1, 0]);
    let members = data(1, &[tags, relation].concat());
    let dense = group(18, &[10, 2, 2, 2, 66, 1, 0, 74, 2, 0, 0]);
    let ids = [&[10, 11][..], &most, &[1, 66, 2, 0, 0, 74, 2, 0, 0]].concat();
    let (ids, latitude) = (group(18, &ids), [&[64][..], &most].concat());
    for (found, expected) in [
        (data(1, &[8]), "a truncated number"),
        (data(1, &[18, 5, 1]), "a field of 5 bytes, but only 1 are left"),
        (data(1, &[10, 2, 8, 1]), "a number, expected bytes"),
        (data(1, &[16, 1]), "a number, expected bytes"),
        (data(1, &[11]), "a field of unknown type"),
        (data(2, &[]), "no data, expected them plain or compressed by zlib"),
        (data(7, &[1]), "data in another compression, expected them plain or compressed by zlib"),
        (data(3, &[1, 2, 3]), "damaged compressed data"),
        (data(3, &stored(&[18, 5, 1])), "a field of 5 bytes, but only 1 are left"),
        (way(&[18, 1, 0, 26, 1, 5]), "string 5, of 1"),
        (way(&[18, 1, 0]), "1 keys of tags and 0 values, expected one each"),
        (members, "1 roles of members, 0 ids and 0 kinds, expected one each"),
        (data(1, &dense), "2 nodes with 1 latitudes and 2 longitudes, expected one each"),
        // The sum of two ids, and the product of a coordinate and its unit.
        (data(1, &ids), "numbers out of their range"),
        (data(1, &group(10, &latitude)), "numbers out of their range"),
    ] {
        assert_eq!(found, expected);
    }
}

fn extract() -> Extract<'static> {
    let nodes = vec![(1, 470_000_000, 95_000_000), (2, 470_000_000, 95_010_000)];
    let ways = vec![(1, &[1, 2][..], &[("highway", "primary")][..])];
    Extract { nodes, ways, ..Extract::default() }
}

#[test]
fn a_truncated_extract_is_an_error_at_every_byte() {
    let bytes = extract().bytes();
    let whole = |bytes: &[u8]| osm(bytes).map(|read| read.1.to_string());
    assert_eq!(whole(&bytes).unwrap(), "read 2 nodes, 2 edges");
    let mut in_blocks = 0;
    for end in 0..bytes.len() {
        match osm(&bytes[..end]) {
            Err(NetworkError::Block { file, byte, .. }) => {
                assert_eq!(file, "extract");
                assert!(byte as usize <= end);
                in_blocks += 1;
            }
            // A file may end between two blocks; one cut before its ways gives an empty map.
            Err(NetworkError::Map(MapError::Empty)) => {}
            other => panic!("{end}: {other:?}"),
        }
    }
    assert_eq!(in_blocks, bytes.len() - 2);
    let cut = osm(&bytes[..bytes.len() - 5]).unwrap_err().to_string();
    assert!(cut.starts_with("extract, block 3 (from byte "), "{cut}");
}

#[test]
fn damaged_extracts_are_errors_or_networks() {
    for zlib in [false, true] {
        let bytes = Extract { zlib, ..extract() }.bytes();
        for place in 0..bytes.len() {
            for bit in 0..8 {
                let mut bytes = bytes.clone();
                bytes[place] ^= 1 << bit;
                if let Ok((network, _)) = osm(&bytes) {
                    assert!(network.edges().iter().all(|edge| edge.metres > 0.0));
                }
            }
        }
    }
    let mut extract = extract();
    extract.relations =
        vec![(&[("type", "restriction"), ("restriction", "no_u_turn")], vec![("via", 9, 1)])];
    let error = osm(&extract.bytes()).unwrap_err().to_string();
    assert!(error.ends_with("a member of kind 9, expected 0 to 2"), "{error}");
}

#[test]
fn other_files_are_no_extracts() {
    let text = osm(b"<?xml version='1.0'?>").unwrap_err().to_string();
    assert!(text.starts_with("extract, block 1 (from byte 0): "), "{text}");
    assert!(text.ends_with("expected an OpenStreetMap extract (.osm.pbf)"), "{text}");
    assert!(matches!(osm(b""), Err(NetworkError::Block { block: 1, .. })));
    let history = [header(&["HistoricalInformation"]), extract().bytes()].concat();
    let text = osm(&history).unwrap_err().to_string();
    assert!(
        text.contains("the file requires \"HistoricalInformation\", which is not supported"),
        "{text}"
    );
    let mut swapped = extract();
    swapped.nodes[1] = (2, 1_491_300_000, -352_800_000);
    let text = osm(&swapped.bytes()).unwrap_err().to_string();
    assert!(
        text.contains("node 2: latitude 149.13 and longitude -35.28 seem to be swapped"),
        "{text}"
    );
    let headless = osm(&extract().bytes()[header(&["OsmSchema-V0.6", "DenseNodes"]).len()..]);
    let text = headless.unwrap_err().to_string();
    assert!(text.contains("expected the header, found other data"), "{text}");
}

#[test]
fn an_empty_box_is_an_error() {
    let corners =
        [Position { latitude: 0.0, longitude: 10.0 }, Position { latitude: 1.0, longitude: 11.0 }];
    let cleaning = vec![Cleaning::Within(corners)];
    let options = ImportOptions::default().with_cleaning(cleaning);
    says(
        RoadNetwork::from_csv(NODES.as_bytes(), &b"from,to\n1,2\n"[..], &options),
        "no node lies in the box of latitude 0 to 1 and longitude 10 to 11; all lie in latitude \
         -35.28 to -35.28 and longitude 149.12 to 149.13",
    );
}
