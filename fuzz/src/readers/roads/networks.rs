//! Checks of networks that were accepted, and of their cleaning.

use wayfix::map::Position;
use wayfix_roads::matching::Matcher;
use wayfix_roads::{Cleaning, ImportNote, ImportOptions, RoadNetwork};

use super::super::check_message;
use super::drives;
use crate::counts::Counts;
use crate::draw::Draw;

/// Checks all queries of a network, and a drive along it.
pub(super) fn check(network: &RoadNetwork) {
    for (index, node) in network.nodes().iter().enumerate() {
        assert_eq!(network.index_of_id(node.id), Some(index));
        check_position(node.position);
        assert!(network.edges_from(index).all(|e| network.edges()[e].from == index));
    }
    for (e, edge) in network.edges().iter().enumerate() {
        assert!(edge.metres > 0.0 && edge.metres.is_finite(), "{edge:?}");
        assert!(edge.speed.is_none_or(|speed| speed > 0.0 && speed.is_finite()), "{edge:?}");
        let shape = network.shape(e);
        shape.iter().for_each(|&position| check_position(position));
        let ends = [edge.from, edge.to].map(|node| network.nodes()[node].position);
        assert_eq!([shape[0], shape[shape.len() - 1]], ends);
        if let Some(back) = network.reverse(e) {
            let other = network.edges()[back];
            assert_eq!(
                (network.reverse(back), other.from, other.to),
                (Some(e), edge.to, edge.from)
            );
        }
        assert!(network.edge_between(edge.from, edge.to).is_some());
        check_position(network.position_along(e, 0.5 * edge.metres));
        let found = network.project(e, ends[1]);
        assert!((0.0..=edge.metres).contains(&found.metres_along) && found.metres_off >= 0.0);
    }
    for (edge, next) in network.forbidden_turns() {
        assert!(!network.may_turn(edge, next));
        assert_eq!(network.edges()[edge].to, network.edges()[next].from);
    }
    let map = network.to_map().expect("places of nodes");
    assert_eq!(map.places().len(), network.nodes().len());
    let text = network.to_geojson();
    let again = RoadNetwork::from_geojson(text.as_bytes(), &ImportOptions::default());
    if !network.edges().is_empty() {
        let (again, report) = again.expect("a network that was written");
        let [read, written] = [&again, network].map(|network| network.edges().len());
        assert!(read >= written, "{written} edges, read back as {read}: {report}");
        // Points at a pole may differ in longitude, but their distance is 0.
        assert!(report.notes().all(|(note, _)| note == ImportNote::ShortLine), "{report}");
    }
    let matcher = Matcher::new(network.clone());
    let positions = network.nodes().iter().take(8).map(|node| node.position);
    drives::along(&matcher, positions);
}

fn check_position(Position { latitude, longitude }: Position) {
    assert!((-90.0..=90.0).contains(&latitude), "latitude {latitude}");
    assert!((-180.0..=180.0).contains(&longitude), "longitude {longitude}");
}

/// Cleans a network with any operations.
pub(super) fn clean(network: RoadNetwork, draw: &mut Draw<'_>, counts: &mut Counts) {
    const DEGREES: [f64; 8] =
        [-180.0, 0.0, 180.0, 149.1005, -35.2995, 1e9, f64::NAN, f64::INFINITY];
    const METRES: [f64; 10] =
        [0.0, -0.0, 1.0, 120.0, 1e4, 1e300, -1.0, f64::NAN, f64::INFINITY, 5e-324];
    let mut corner = || Position { latitude: draw.pick(&DEGREES), longitude: draw.pick(&DEGREES) };
    let corners = [corner(), corner()];
    let operations = [
        draw.one_in(4).then_some(Cleaning::Within(corners)),
        draw.one_in(2).then_some(Cleaning::LargestComponent),
        draw.one_in(3).then_some(Cleaning::DeadEnds),
        (!draw.one_in(3)).then_some(Cleaning::Contraction),
        draw.one_in(2).then(|| Cleaning::Merging { metres: draw.pick(&METRES) }),
        draw.one_in(2).then_some(Cleaning::Contraction),
    ];
    let cleaning: Vec<Cleaning> = operations.into_iter().flatten().collect();
    counts.note(|| format!("{cleaning:?}"));
    match network.cleaned(&cleaning) {
        Ok((network, steps)) => {
            counts.add("networks cleaned");
            let last = steps.last().map(|step| [step.nodes[1], step.edges[1]]);
            let now = [network.nodes().len(), network.edges().len()];
            assert!(last.is_none_or(|last| last == now));
            assert!(!network.nodes().is_empty());
            check(&network);
        }
        Err(error) => {
            counts.add("cleanings refused");
            check_message(&error);
        }
    }
}
