//! Places GPS drives on a road network.
#![allow(missing_docs)]
use clap::Parser;
use std::error::Error;
use std::fs::{self, File};
use std::path::PathBuf;
use std::time::Instant;
use wayfix::map::*;
use wayfix::matching::*;

#[derive(Parser)]
struct Arguments {
    #[arg(long)]
    roads: PathBuf,
    #[arg(long)]
    trace: PathBuf,
    #[arg(long, default_value_t = 1)]
    every: usize,
    #[arg(long)]
    noise: Option<f64>,
    #[arg(long, default_value = "target/drive")]
    out: PathBuf,
}
fn main() -> Result<(), Box<dyn Error>> {
    let a = Arguments::parse();
    let t = Instant::now();
    let mut b = NetworkBuilder::new();
    let mut r = csv::Reader::from_path(a.roads.join("nodes.csv"))?;
    for l in r.records() {
        let l = l?;
        b.node(l[0].parse()?, Position { longitude: l[1].parse()?, latitude: l[2].parse()? })?;
    }
    let mut r = csv::Reader::from_path(a.roads.join("edges.csv"))?;
    for l in r.records() {
        let l = l?;
        let class = [RoadClass::Street, RoadClass::Collector, RoadClass::Arterial, RoadClass::Main]
            [l[2].parse::<usize>()?];
        let m: f64 = l[3].parse()?;
        b.edge(
            l[0].parse()?,
            l[1].parse()?,
            EdgeOptions { metres: Some(m.max(0.1)), ..EdgeOptions::of(class) },
        )?;
    }
    let network = b.build()?;
    eprintln!("network {:?}", t.elapsed());
    let t = Instant::now();
    let mut matcher = Matcher::new(network);
    if let Some(noise) = a.noise {
        let m = *matcher.model();
        matcher = matcher.with_model(MatchModel { noise, ..m })?;
    }
    eprintln!("index {:?}", t.elapsed());
    let (traces, skipped) = read_traces(&a.trace)?;
    eprintln!("{skipped}");
    if a.noise.is_none() {
        let p: Vec<Vec<_>> =
            traces.iter().map(|t| t.points.iter().step_by(a.every).copied().collect()).collect();
        let p: Vec<&[_]> = p.iter().map(|p| &p[..]).collect();
        let t = Instant::now();
        let m = *matcher.model();
        matcher = matcher.with_model(MatchModel { noise: 20.0, ..m })?;
        let f = matcher.fit(&p, 20, &mut MatchMemory::default())?;
        eprintln!("{f:?} {:?}", t.elapsed());
        matcher = matcher.with_model(f.model)?;
    }
    fs::create_dir_all(&a.out)?;
    let mut rw = RouteWriter::new(File::create(a.out.join("route.csv"))?)?;
    let mut pw = PointWriter::new(File::create(a.out.join("points.csv"))?)?;
    let mut memory = MatchMemory::default();
    let (mut time, mut points, mut cands) = (0.0, 0, 0.0);
    for trace in &traces {
        let p: Vec<_> = trace.points.iter().step_by(a.every).copied().collect();
        let t = Instant::now();
        let drive = matcher.match_drive(&p, &mut memory)?;
        time += t.elapsed().as_secs_f64();
        points += p.len();
        cands += drive.candidates() * p.len() as f64;
        rw.write(&trace.name, &matcher, &drive)?;
        pw.write(&trace.name, &matcher, &drive, 3)?;
    }
    println!(
        "{} drives, {points} points, {:.0} points/s, {:.1} candidates",
        traces.len(),
        points as f64 / time,
        cands / points as f64
    );
    Ok(())
}
