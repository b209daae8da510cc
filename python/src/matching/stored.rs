//! The form of a network in a pickle: what a `NetworkBuilder` needs to build it again. GeoJSON
//! would not do, since it has no ids and no forbidden turns.

use serde::{Deserialize, Serialize};
use wayfix::map::{Place, Position, RoadClass};
use wayfix_roads::{EdgeOptions, NetworkBuilder, NetworkError, RoadNetwork};

type Point = (f64, f64);

/// Network without what is computed from it. Numbers are kept to the bit.
#[derive(Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Stored {
    /// Id, position and name.
    nodes: Vec<(u64, Point, String)>,
    edges: Vec<StoredEdge>,
    /// Edges that are the two directions of one road.
    pairs: Vec<(usize, usize)>,
    /// Forbidden turns, from edge to edge.
    forbidden: Vec<(usize, usize)>,
}

/// Ids of the ends, class, metres, speed, true on a roundabout, and the points between the ends.
type StoredEdge = (u64, u64, String, f64, Option<f64>, bool, Vec<Point>);

fn point(position: &Position) -> Point {
    (position.latitude, position.longitude)
}

fn position((latitude, longitude): Point) -> Position {
    Position { latitude, longitude }
}

impl Stored {
    pub(super) fn of(network: &RoadNetwork) -> Self {
        let (nodes, edges) = (network.nodes(), network.edges());
        let edge = |(number, edge): (usize, &wayfix_roads::Edge)| {
            let [from, to] = [edge.from, edge.to].map(|end| nodes[end].id);
            // The first and the last point of a line are its nodes.
            let line = network.shape(number);
            let between = line[1..line.len() - 1].iter().map(point).collect();
            let class = edge.class.to_string();
            (from, to, class, edge.metres, edge.speed, edge.roundabout, between)
        };
        // Each pair once, from its lower number; an edge may be its own reverse.
        let pair =
            |edge| network.reverse(edge).filter(|back| edge <= *back).map(|back| (edge, back));
        Self {
            nodes: nodes.iter().map(|n| (n.id, point(&n.position), n.name.clone())).collect(),
            edges: edges.iter().enumerate().map(edge).collect(),
            pairs: (0..edges.len()).filter_map(pair).collect(),
            forbidden: network.forbidden_turns().collect(),
        }
    }

    pub(super) fn network(self) -> Result<RoadNetwork, String> {
        let text = |error: NetworkError| error.to_string();
        let mut builder = NetworkBuilder::new();
        for (id, point, name) in self.nodes {
            builder.place(Place { id, position: position(point), name }).map_err(text)?;
        }
        let mut ends = Vec::with_capacity(self.edges.len());
        for (from, to, class, metres, speed, roundabout, between) in self.edges {
            let class: RoadClass = class.parse()?;
            let between = between.into_iter().map(position).collect();
            let options = EdgeOptions::of(class)
                .with_metres(metres)
                .with_speed(speed)
                .with_roundabout(roundabout)
                .with_between(between);
            builder.edge(from, to, options).map_err(text)?;
            ends.push((from, to));
        }
        // The builder panics on edges that do not exist and on pairs that are not opposite; a
        // pickle from outside promises neither.
        for (edge, back) in self.pairs {
            let opposite = ends.get(edge).map(|&(from, to)| (to, from));
            if opposite.is_none() || opposite.as_ref() != ends.get(back) {
                return Err(format!("edges {edge} and {back} are not opposite"));
            }
            builder.pair(edge, back);
        }
        for (edge, next) in self.forbidden {
            if edge.max(next) >= ends.len() {
                return Err(format!("there is no turn from edge {edge} to {next}"));
            }
            builder.forbid(edge, next);
        }
        builder.build().map_err(text)
    }
}
