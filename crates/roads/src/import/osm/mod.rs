//! Networks from OpenStreetMap extracts.
//!
//! The first pass takes ways and restrictions and remembers which blocks have nodes; the second
//! looks up the positions of those nodes that roads use. So memory grows with the roads, and not
//! with all nodes of the extract.

mod blocks;
mod elements;
mod restrictions;
mod wire;

use std::collections::HashMap;
use std::io::{BufReader, Read, Seek};
use std::path::Path;

use self::blocks::Blocks;
use self::elements::{Block, Element, Member, Relation, Way};
use self::restrictions::Restriction;
use super::lines::Lines;
use super::report::ImportOptions;
use super::report::{ImportNote, ImportReport};
use super::report::{finish, position_problem};
use super::tags::road_of;
use crate::{NetworkBuilder, NetworkError, RoadNetwork};
use wayfix::internal::open;
use wayfix::map::Position;

impl RoadNetwork {
    /// Reads a network from an OpenStreetMap extract (`.osm.pbf`).
    ///
    /// Ways with a `highway` tag for cars become roads, split where they share a node. Ids are
    /// those of the extract.
    ///
    /// - Class: motorway, trunk and primary are main roads, secondary ones arterial, tertiary ones
    ///   collectors, each with its links; unclassified, residential and service roads and living
    ///   streets are streets. [`ImportOptions`] choose service roads, tracks and private roads.
    /// - Access: the most specific tag of `motorcar`, `motor_vehicle`, `vehicle` and `access`
    ///   decides. Gates and bollards on nodes don't count.
    /// - Direction: `oneway`; motorways and roundabouts are one-way unless it is no. Reversible
    ///   roads are read as two-way, since a vehicle may be on them in either direction.
    /// - Speed: `maxspeed` in km/h or mph. Names of rules (`CH:urban`) are counted and ignored.
    /// - Turn restrictions over a node between the roads, except those that exempt cars. A road to
    ///   which a vehicle must turn (`only_…`) forbids all others, including the way back.
    ///
    /// A road through nodes that the file does not contain is cut there; whatever is skipped or
    /// replaced is counted in the report.
    ///
    /// The file is read twice, so that memory grows with the roads alone. A block is decoded as a
    /// whole: up to 32 MB, which may be compressed to a few kilobytes, and some twenty times as
    /// much in memory for a malicious file. O(bytes + edges log).
    ///
    /// # Errors
    ///
    /// [`NetworkError::Block`] with file, block and byte for a file that is not an extract, is
    /// truncated or damaged, or requires unsupported features (history), and for a node not on
    /// Earth; [`NetworkError::Read`] if the file can't be opened; [`NetworkError::Map`] if no road
    /// is left; and those of [`cleaned`](Self::cleaned).
    pub fn from_osm_file(
        path: impl AsRef<Path>,
        options: &ImportOptions,
    ) -> Result<(Self, ImportReport), NetworkError> {
        let (file, reader) = open(path.as_ref())?;
        read(&file, BufReader::new(reader), options)
    }

    /// Reads a network from a reader, as [`from_osm_file`](Self::from_osm_file) does from a file;
    /// errors call it "extract". The reader is read twice from its start.
    ///
    /// # Errors
    ///
    /// As [`from_osm_file`](Self::from_osm_file).
    pub fn from_osm(
        reader: impl Read + Seek,
        options: &ImportOptions,
    ) -> Result<(Self, ImportReport), NetworkError> {
        read("extract", reader, options)
    }
}

fn read(
    file: &str,
    reader: impl Read + Seek,
    options: &ImportOptions,
) -> Result<(RoadNetwork, ImportReport), NetworkError> {
    let mut report = ImportReport::default();
    let mut roads = Roads::default();
    let mut blocks = Blocks::new(file, reader);
    let with_nodes = blocks.each(|block| roads.take(block, options, &mut report))?;
    blocks.each_of(&with_nodes, |block| roads.locate(block))?;

    let Roads { lines, ways, restrictions } = roads;
    let mut builder = NetworkBuilder::new();
    let pieces = lines.split(&mut builder, &mut report)?;
    restrictions::forbid(&restrictions, &ways, &pieces, &mut builder, &mut report);
    finish(builder, report, options)
}

/// Roads and turn restrictions of an extract.
#[derive(Default)]
struct Roads {
    lines: Lines,
    /// Id of the way of each line.
    ways: Vec<i64>,
    restrictions: Vec<Restriction>,
}

impl Roads {
    /// Takes the roads and turn restrictions of a block. Returns true if the block has nodes.
    fn take(
        &mut self,
        block: &Block<'_>,
        options: &ImportOptions,
        report: &mut ImportReport,
    ) -> Result<bool, String> {
        let mut has_nodes = false;
        block.each_element(|element| {
            let taken = match element {
                Element::Node(_) | Element::Nodes(_) => {
                    has_nodes = true;
                    Ok(())
                }
                Element::Way(message) => {
                    self.take_way(block, &Way::parse(message)?, options, report)?
                }
                Element::Relation(message) => {
                    self.take_relation(block, &Relation::parse(message)?)?
                }
            };
            if let Err(note) = taken {
                report.note(note);
            }
            Ok(())
        })?;
        Ok(has_nodes)
    }

    /// Takes a way if it is a road, or returns the reason why it is skipped.
    fn take_way(
        &mut self,
        block: &Block<'_>,
        way: &Way,
        options: &ImportOptions,
        report: &mut ImportReport,
    ) -> Result<Result<(), ImportNote>, String> {
        // Most ways are buildings and the like, whose tags need not be decoded.
        if !block.has_key(&way.tags, "highway") {
            return Ok(Ok(()));
        }
        let tags = block.tags(&way.tags)?;
        let tag = |name: &str| tags.iter().find(|(key, _)| *key == name).map(|(_, value)| *value);
        let road = match road_of(tag, options, report) {
            Ok(road) => road,
            Err(note) => return Ok(Err(note)),
        };
        let points = way.nodes().map(|id| id.map(i64::cast_unsigned));
        if !self.lines.add(points.collect::<Result<_, _>>()?, road, None) {
            return Ok(Err(ImportNote::NoLine));
        }
        self.ways.push(way.id);
        Ok(Ok(()))
    }

    /// Takes a relation if it is a turn restriction, or returns the reason why it is not used.
    fn take_relation(
        &mut self,
        block: &Block<'_>,
        relation: &Relation,
    ) -> Result<Result<(), ImportNote>, String> {
        let tags: HashMap<&str, &str> = block.tags(&relation.tags)?.into_iter().collect();
        if tags.get("type") != Some(&"restriction") {
            return Ok(Ok(()));
        }
        let members = block.members(relation)?.into_iter();
        // A restriction never leads over a relation.
        let members = members.filter(|member| member.1 != Member::Relation);
        let members = members.map(|(role, kind, id)| (role, kind == Member::Node, id));
        let restriction = Restriction::of(&tags, &members.collect::<Vec<_>>());
        Ok(restriction.map(|restriction| self.restrictions.push(restriction)))
    }

    /// Stores the positions of nodes that roads use.
    fn locate(&mut self, block: &Block<'_>) -> Result<(), String> {
        let mut place = |id: i64, nanodegrees: [i64; 2]| {
            let Some(point) = self.lines.points.get_mut(&id.cast_unsigned()) else { return Ok(()) };
            // A single division rounds once, so the position is the double nearest to its decimals.
            let [latitude, longitude] = nanodegrees.map(|degrees| degrees as f64 / 1e9);
            let position = Position { latitude, longitude };
            if let Some(problem) = position_problem(position) {
                return Err(format!("node {id}: {problem}"));
            }
            point.position = Some(position);
            Ok(())
        };
        block.each_element(|element| match element {
            Element::Node(message) => block.node(message, &mut place),
            Element::Nodes(message) => block.nodes(message, &mut place),
            Element::Way(_) | Element::Relation(_) => Ok(()),
        })
    }
}
