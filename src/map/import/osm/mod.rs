//! Networks from OpenStreetMap extracts.

mod blocks;
mod restrictions;

use std::collections::HashMap;
use std::io::{BufReader, Read, Seek};
use std::path::Path;

use osmpbf::{PrimitiveBlock, RelMemberType, Way};

use self::blocks::Blocks;
use self::restrictions::Restriction;
use super::finish::{finish, position_problem};
use super::lines::Lines;
use super::options::ImportOptions;
use super::report::{ImportNote, ImportReport};
use super::tags::road_of;
use crate::files::open;
use crate::map::{MapError, NetworkBuilder, Position, RoadNetwork};

impl RoadNetwork {
    /// Reads a network from an OpenStreetMap extract (`.osm.pbf`).
    ///
    /// Ways with a `highway` tag for cars become roads, split where they share a node. Ids are
    /// those of the extract.
    ///
    /// - Class: motorway, trunk and primary are main roads, secondary ones arterial, tertiary ones
    ///   collectors, each with its links; unclassified, residential and service roads and living
    ///   streets are streets. [`ImportOptions`] choose service roads, tracks and private roads.
    /// - Access: the most specific of `motorcar`, `motor_vehicle`, `vehicle` and `access` decides.
    ///   Gates and bollards on nodes don't count.
    /// - Direction: `oneway`; motorways and roundabouts are one-way unless it says no. Reversible
    ///   roads are taken as two-way, since a vehicle may be on them in either direction.
    /// - Speed: `maxspeed` in km/h or mph. Names of rules (`CH:urban`) are counted, not taken.
    /// - Turn restrictions with a node between the roads, those with exceptions for cars left out.
    ///   A road to which a vehicle must turn (`only_…`) forbids all others, back included.
    ///
    /// A road through nodes that the file does not hold is cut there; what is skipped or replaced
    /// is counted in the report.
    ///
    /// The file is read twice, so that memory grows with the roads alone. A block is decoded as a
    /// whole: up to 32 MB that may be compressed to a few kilobytes, and a hundred times as much in
    /// memory in a file made to harm. O(bytes + edges log).
    ///
    /// # Errors
    ///
    /// [`MapError::Block`] with file, block and byte for a file that is no extract, is truncated or
    /// damaged, or needs what is not supported (history), and for a node not on Earth;
    /// [`MapError::Read`] if the file can't be opened; [`MapError::Empty`] if no road is left; and
    /// those of [`cleaned`](Self::cleaned).
    pub fn from_osm_file(
        path: impl AsRef<Path>,
        options: &ImportOptions,
    ) -> Result<(Self, ImportReport), MapError> {
        let (file, reader) = open(path.as_ref())?;
        read(&file, BufReader::new(reader), options)
    }

    /// Reads a network from a reader, as [`from_osm_file`](Self::from_osm_file); errors call it
    /// "extract". It is read from its start, twice.
    ///
    /// # Errors
    ///
    /// As [`from_osm_file`](Self::from_osm_file).
    pub fn from_osm(
        reader: impl Read + Seek + Send,
        options: &ImportOptions,
    ) -> Result<(Self, ImportReport), MapError> {
        read("extract", reader, options)
    }
}

fn read(
    file: &str,
    reader: impl Read + Seek + Send,
    options: &ImportOptions,
) -> Result<(RoadNetwork, ImportReport), MapError> {
    let mut report = ImportReport::default();
    let mut roads = Roads::default();
    let mut blocks = Blocks::new(file, reader)?;
    let with_nodes = blocks.each(|block| roads.take(block, options, &mut report))?;
    blocks.each_of(&with_nodes, |block| roads.locate(block))?;

    let Roads { lines, ways, restrictions } = roads;
    let mut builder = NetworkBuilder::new();
    let pieces = lines.split(&mut builder, &mut report)?;
    restrictions::forbid(&restrictions, &ways, &pieces, &mut builder, &mut report);
    finish(builder, report, options)
}

/// Roads of an extract.
#[derive(Default)]
struct Roads {
    lines: Lines,
    /// Id of the way of each line.
    ways: Vec<i64>,
    restrictions: Vec<Restriction>,
}

impl Roads {
    /// Takes the roads and turn restrictions of a block. Returns true if it has nodes.
    fn take(
        &mut self,
        block: &PrimitiveBlock,
        options: &ImportOptions,
        report: &mut ImportReport,
    ) -> Result<bool, String> {
        let mut nodes = false;
        for group in block.groups() {
            nodes |= group.nodes().next().is_some() || group.dense_nodes().next().is_some();
            for way in group.ways() {
                if let Err(note) = self.take_way(&way, options, report) {
                    report.note(note);
                }
            }
            for relation in group.relations() {
                let tags: HashMap<&str, &str> = relation.tags().collect();
                if tags.get("type") != Some(&"restriction") {
                    continue;
                }
                let mut members = Vec::new();
                for member in relation.members() {
                    let role = member.role().map_err(|error| error.to_string())?;
                    let node = match member.member_type {
                        RelMemberType::Node => true,
                        RelMemberType::Way => false,
                        RelMemberType::Relation => continue,
                    };
                    members.push((role, node, member.member_id));
                }
                match Restriction::of(&tags, &members) {
                    Ok(restriction) => self.restrictions.push(restriction),
                    Err(note) => report.note(note),
                }
            }
        }
        Ok(nodes)
    }

    fn take_way(
        &mut self,
        way: &Way<'_>,
        options: &ImportOptions,
        report: &mut ImportReport,
    ) -> Result<(), ImportNote> {
        if !way.tags().any(|(key, _)| key == "highway") {
            return Ok(());
        }
        let tag = |name: &str| way.tags().find(|(key, _)| *key == name).map(|(_, value)| value);
        let road = road_of(tag, options, report)?;
        let points = way.refs().map(i64::cast_unsigned).collect();
        if !self.lines.add(points, road, None) {
            return Err(ImportNote::NoLine);
        }
        self.ways.push(way.id());
        Ok(())
    }

    /// Takes the positions of nodes that roads use.
    fn locate(&mut self, block: &PrimitiveBlock) -> Result<(), String> {
        let mut place = |id: i64, nanodegrees: [i64; 2]| {
            let Some(point) = self.lines.points.get_mut(&id.cast_unsigned()) else { return Ok(()) };
            // Divided so, a position is the number that its decimals mean.
            let [latitude, longitude] = nanodegrees.map(|degrees| degrees as f64 / 1e9);
            let position = Position { latitude, longitude };
            if let Some(problem) = position_problem(position) {
                return Err(format!("node {id}: {problem}"));
            }
            point.position = Some(position);
            Ok(())
        };
        for group in block.groups() {
            for node in group.nodes() {
                place(node.id(), [node.nano_lat(), node.nano_lon()])?;
            }
            for node in group.dense_nodes() {
                place(node.id(), [node.nano_lat(), node.nano_lon()])?;
            }
        }
        Ok(())
    }
}
