//! Networks from files.

mod bad_files;
mod formats;
mod osm;
mod pbf;

use wayfix_roads::NetworkError;
use wayfix_roads::{ImportOptions, ImportReport, RoadNetwork};

type Read = Result<(RoadNetwork, ImportReport), NetworkError>;

fn csv(nodes: &str, edges: &str) -> Read {
    RoadNetwork::from_csv(nodes.as_bytes(), edges.as_bytes(), &ImportOptions::default())
}

fn geojson(text: &str) -> Read {
    RoadNetwork::from_geojson(text.as_bytes(), &ImportOptions::default())
}

fn osm(bytes: &[u8]) -> Read {
    RoadNetwork::from_osm(std::io::Cursor::new(bytes), &ImportOptions::default())
}

/// Edges by the ids of their ends, in ascending order.
fn ends(network: &RoadNetwork) -> Vec<[u64; 2]> {
    let id = |node: usize| network.nodes()[node].id;
    let mut ends: Vec<_> = network.edges().iter().map(|e| [id(e.from), id(e.to)]).collect();
    ends.sort_unstable();
    ends
}

/// Forbidden turns by the ids of their three nodes, in ascending order.
fn turns(network: &RoadNetwork) -> Vec<[u64; 3]> {
    let id = |node: usize| network.nodes()[node].id;
    let turn = |(a, b): (usize, usize)| {
        let [a, b] = [a, b].map(|e| network.edges()[e]);
        assert_eq!(a.to, b.from);
        [id(a.from), id(a.to), id(b.to)]
    };
    let mut turns: Vec<_> = network.forbidden_turns().map(turn).collect();
    turns.sort_unstable();
    turns
}
