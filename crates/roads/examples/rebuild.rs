//! Compares the bundled 105 intersections with those that the import makes from files of the whole
//! city: prints a table, and draws both in `target/rebuild.svg`. Run with `-- --roads FOLDER`.

use std::error::Error;
use std::fmt::Write as _;
use std::fs;
use std::path::PathBuf;

use clap::Parser;
use wayfix::canberra;
use wayfix::map::{Position, RoadClass, RoadMap};
use wayfix_roads::{EdgeOptions, ImportOptions, NetworkBuilder, RoadNetwork};

#[derive(Parser)]
struct Arguments {
    #[arg(long)]
    roads: Option<PathBuf>,
}

/// Corners of the city centre.
const CORNERS: [Position; 2] = [
    Position { latitude: -35.292, longitude: 149.116 },
    Position { latitude: -35.274, longitude: 149.145 },
];
/// Metres within which intersections are merged.
const MERGE: f64 = 45.0;
const CLASSES: [(RoadClass, &str); 4] = [
    (RoadClass::Street, "#9aa5b1"),
    (RoadClass::Collector, "#4c9f70"),
    (RoadClass::Arterial, "#2f6db5"),
    (RoadClass::Main, "#c0392b"),
];

/// Drops loops, and all but the shortest of parallel roads, so that more nodes are merely passed
/// through and can be contracted.
fn simple(network: &RoadNetwork) -> Result<RoadNetwork, Box<dyn Error>> {
    let mut builder = NetworkBuilder::new();
    network.nodes().iter().try_for_each(|node| builder.node(node.id, node.position).map(drop))?;
    for road in network.to_map()?.roads() {
        let options = EdgeOptions::of(road.class).with_metres(road.metres);
        builder.edge(road.from, road.to, options)?;
    }
    Ok(builder.build()?)
}

/// Cuts the centre out of a city, then merges, drops dead ends and contracts until nothing changes.
fn rebuild(city: &RoadNetwork) -> Result<RoadMap, Box<dyn Error>> {
    let mut network = city.within(CORNERS)?.0.largest_component().0;
    loop {
        // Merging joins nodes, which makes parallel roads; dropping those opens dead ends and
        // passages, whose removal brings nodes near each other: each round can enable the next.
        // None adds a node, so rounds end.
        let before = (network.nodes().len(), network.edges().len());
        let open = simple(&network.merged(MERGE)?.0)?.without_dead_ends().0;
        network = open.contracted().0;
        if before == (network.nodes().len(), network.edges().len()) {
            return Ok(network.to_map()?);
        }
    }
}

/// Draws a map, shifted to the right by some pixels.
fn draw(svg: &mut String, map: &RoadMap, right: f64) -> Result<(), std::fmt::Error> {
    let [low, high] = CORNERS;
    let at = |p: Position| {
        let x = right + 560.0 * (p.longitude - low.longitude) / (high.longitude - low.longitude);
        (x, 30.0 + 424.0 * (high.latitude - p.latitude) / (high.latitude - low.latitude))
    };
    for (from, place) in map.places().iter().enumerate() {
        let (x, y) = at(place.position);
        for (to, road) in map.roads_from(from) {
            let (u, v) = at(map.places()[to].position);
            let colour = CLASSES[road.class as usize].1;
            writeln!(svg, "<path d='M{x:.1},{y:.1}L{u:.1},{v:.1}' stroke='{colour}'/>")?;
        }
        writeln!(svg, "<circle cx='{x:.1}' cy='{y:.1}' r='2.5'/>")?;
    }
    Ok(())
}

const ROWS: &str =
    "places,roads,street,collector,arterial,main,mean length,within 60 m of the other";

/// Numbers of a map compared with another one, for each row.
fn figures(map: &RoadMap, other: &RoadMap) -> Vec<String> {
    let roads = map.roads();
    let metres: f64 = roads.iter().map(|road| road.metres).sum();
    let near = |at: Position| other.places().iter().any(|p| p.position.metres_to(at) <= 60.0);
    let near = map.places().iter().filter(|place| near(place.position)).count();
    let mut figures = vec![map.places().len().to_string(), roads.len().to_string()];
    figures.extend(
        CLASSES.map(|class| roads.iter().filter(|road| road.class == class.0).count().to_string()),
    );
    figures.push(format!("{:.0} m", metres / roads.len() as f64));
    figures.push(format!("{:.0}%", 100.0 * near as f64 / map.places().len() as f64));
    figures
}

fn main() -> Result<(), Box<dyn Error>> {
    let arguments = Arguments::parse();
    let Some(roads) = arguments.roads else {
        println!("--roads FOLDER is required: a folder with nodes.csv and edges.csv of Canberra");
        return Ok(());
    };
    let (city, _) = RoadNetwork::from_path(roads, &ImportOptions::default())?;
    let maps = [canberra::map(), rebuild(&city)?];
    let [bundled, rebuilt] = [figures(&maps[0], &maps[1]), figures(&maps[1], &maps[0])];
    let mut svg = String::from(
        "<svg xmlns='http://www.w3.org/2000/svg' viewBox='0 0 1180 660' font-family='sans-serif'>\n",
    );
    for (map, name, x) in [(&maps[0], "bundled", 20), (&maps[1], "rebuilt", 600)] {
        writeln!(svg, "<text x='{x}' y='20'>{name}</text>")?;
        draw(&mut svg, map, x.into())?;
    }
    for ((row, (a, b)), y) in
        ROWS.split(',').zip(bundled.iter().zip(&rebuilt)).zip((490..).step_by(21))
    {
        println!("{row:24} {a:>8} {b:>8}");
        for (x, text) in [(20, row), (240, a), (340, b)] {
            writeln!(svg, "<text x='{x}' y='{y}'>{text}</text>")?;
        }
    }
    fs::create_dir_all("target")?;
    fs::write("target/rebuild.svg", svg + "</svg>\n")?;
    Ok(())
}
