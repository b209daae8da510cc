//! Simulated drives in a made-up city, written to files as a user would have them.

use std::error::Error;
use std::path::Path;

use csv::Writer;
use rand_chacha::{ChaCha8Rng, rand_core::SeedableRng};
use wayfix_roads::RoadNetwork;

use super::roads::{self, simulate, town};
use simulate::Scenario;

const DRIVES: usize = 40;

/// Writes the roads, the drives and the true routes to files.
pub(crate) fn write(out: &Path) -> Result<(), Box<dyn Error>> {
    let network = town::network()?;
    let mut rng = ChaCha8Rng::seed_from_u64(1);
    // Noisier than the model's default, so that learning has something to find.
    let scenario = Scenario { noise: 12.0, ..Scenario::default() };
    let drives: Result<Vec<_>, _> =
        (0..DRIVES).map(|_| simulate::drive(&network, &scenario, &mut rng)).collect();
    write_all(out, &network, &drives?).map_err(|error| roads::cannot_write(out, error).into())
}

fn write_all(
    out: &Path,
    network: &RoadNetwork,
    drives: &[simulate::Simulated],
) -> Result<(), csv::Error> {
    let ends = |edge: usize| {
        let edge = network.edges()[edge];
        [edge.from, edge.to].map(|node| network.nodes()[node].id.to_string())
    };
    let mut nodes = Writer::from_path(out.join("nodes.csv"))?;
    // Files of roads have the columns that the import reads; six decimals of a degree are 0.1 m.
    nodes.write_record(["node", "lon", "lat"])?;
    for node in network.nodes() {
        let degrees = [node.position.longitude, node.position.latitude];
        let [longitude, latitude] = degrees.map(|degrees| format!("{degrees:.6}"));
        nodes.write_record([node.id.to_string(), longitude, latitude])?;
    }
    nodes.flush()?;

    let mut edges = Writer::from_path(out.join("edges.csv"))?;
    edges.write_record(["from", "to", "class", "length_m"])?;
    for (number, edge) in network.edges().iter().enumerate() {
        let [from, to] = ends(number);
        edges.write_record([from, to, edge.class.to_string(), format!("{:.1}", edge.metres)])?;
    }
    edges.flush()?;

    let mut points = Writer::from_path(out.join("trace.csv"))?;
    points.write_record(["trace", "time", "longitude", "latitude"])?;
    let mut truth = Writer::from_path(out.join("truth.csv"))?;
    truth.write_record(["trace", "order", "from", "to", "enter_m", "exit_m", "time"])?;
    for (number, drive) in drives.iter().enumerate() {
        let name = (number + 1).to_string();
        for point in &drive.points {
            let degrees = [point.position.longitude, point.position.latitude];
            let [longitude, latitude] = degrees.map(|degrees| format!("{degrees:.6}"));
            points.write_record([&name, &point.time.to_string(), &longitude, &latitude])?;
        }
        let mut at = drive.truth.iter().zip(&drive.points).peekable();
        for (order, part) in drive.route.iter().enumerate() {
            let is_on = |truth: &Option<(usize, f64)>| match truth {
                Some((edge, along)) => {
                    part.edge == Some(*edge) && (part.enter..=part.exit).contains(along)
                }
                None => part.edge.is_none(),
            };
            // Points and parts are both in order of time: the first point on this part, if any, is
            // next. Further ones on it are skipped.
            let time = at.peek().filter(|(truth, _)| is_on(truth)).map(|(_, point)| point.time);
            while at.next_if(|(truth, _)| is_on(truth)).is_some() {}
            let [from, to] = part.edge.map_or_else(Default::default, ends);
            let metres = [part.enter, part.exit].map(|metres| format!("{metres:.1}"));
            let [enter, exit] = if part.edge.is_some() { metres } else { Default::default() };
            let time = time.map_or_else(String::new, |time| time.to_string());
            truth.write_record([&name, &order.to_string(), &from, &to, &enter, &exit, &time])?;
        }
    }
    points.flush()?;
    truth.flush()?;
    Ok(())
}
