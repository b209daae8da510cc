//! Turn restrictions of OpenStreetMap, translated to pairs of edges.

use std::collections::{HashMap, HashSet};

use super::super::lines::Piece;
use super::super::report::{ImportNote, ImportReport};
use crate::NetworkBuilder;

/// Restriction of the turns from some ways over a node to others.
#[derive(Debug)]
pub(super) struct Restriction {
    /// True if these are the only turns allowed, false if they are forbidden.
    only: bool,
    via: u64,
    from: Vec<i64>,
    to: Vec<i64>,
}

impl Restriction {
    /// Restriction with these tags and members (role, true for a node, id), or the reason why it is
    /// not used.
    pub(super) fn of(
        tags: &HashMap<&str, &str>,
        members: &[(&str, bool, i64)],
    ) -> Result<Self, ImportNote> {
        let kinds = ["restriction:motorcar", "restriction:motor_vehicle", "restriction"];
        let Some(kind) = kinds.iter().find_map(|key| tags.get(key)) else {
            // No restriction applies to cars at all times: the note tells which kind there is
            // instead.
            let by_hour = tags.keys().any(|key| key.ends_with(":conditional"));
            let others = tags.keys().any(|key| key.starts_with("restriction:"));
            return Err(match (by_hour, others) {
                (true, _) => ImportNote::RestrictionByHour,
                (_, true) => ImportNote::RestrictionForOthers,
                _ => ImportNote::RestrictionUnused,
            });
        };
        let mut except = tags.get("except").into_iter().flat_map(|list| list.split(';'));
        if except.any(|vehicle| matches!(vehicle.trim(), "motorcar" | "motor_vehicle")) {
            return Err(ImportNote::RestrictionForOthers);
        }
        let only = kind.starts_with("only_");
        if !only && !kind.starts_with("no_") {
            return Err(ImportNote::RestrictionUnused);
        }
        if members.iter().any(|&(role, node, _)| role == "via" && !node) {
            return Err(ImportNote::RestrictionThroughWay);
        }
        let of_role = |wanted: &str, node: bool| -> Vec<i64> {
            let members = members.iter().filter(|member| (member.0, member.1) == (wanted, node));
            members.map(|member| member.2).collect()
        };
        match of_role("via", true)[..] {
            [via] => {
                let (from, to) = (of_role("from", false), of_role("to", false));
                Ok(Self { only, via: via.cast_unsigned(), from, to })
            }
            _ => Err(ImportNote::RestrictionUnused),
        }
    }
}

/// Forbids the turns of restrictions. `ways` are the way ids of the lines.
pub(super) fn forbid(
    restrictions: &[Restriction],
    ways: &[i64],
    pieces: &[Piece],
    builder: &mut NetworkBuilder,
    report: &mut ImportReport,
) {
    // Ends of pieces are indexed only at nodes and for ways that a restriction names: an extract
    // has millions of pieces and thousands of restrictions.
    let named = restrictions.iter().flat_map(|r| r.from.iter().chain(&r.to)).copied();
    let named: HashSet<i64> = named.collect();
    let vias: HashSet<u64> = restrictions.iter().map(|restriction| restriction.via).collect();
    let mut into: HashMap<(u64, i64), Vec<usize>> = HashMap::new();
    let mut out: HashMap<u64, Vec<usize>> = HashMap::new();
    for (edge, piece) in pieces.iter().enumerate() {
        let [from, to] = piece.ends;
        if vias.contains(&to) && named.contains(&ways[piece.line]) {
            into.entry((to, ways[piece.line])).or_default().push(edge);
        }
        if vias.contains(&from) {
            out.entry(from).or_default().push(edge);
        }
    }
    for Restriction { only, via, from, to } in restrictions {
        let out = out.get(via).map(Vec::as_slice).unwrap_or_default();
        let arrive = from.iter().filter_map(|&way| into.get(&(*via, way))).flatten();
        let mut used = false;
        for &edge in arrive {
            let listed = |&&next: &&usize| {
                let (way, back) = (ways[pieces[next].line], pieces[edge].back == Some(next));
                // A restriction from a way to itself is about the U-turn, not about going straight
                // on where the way passes the node.
                to.contains(&way) && (back || way != ways[pieces[edge].line])
            };
            // An `only_…` restriction whose road is not in the network must not forbid all others.
            if out.iter().any(|next| listed(&next)) {
                used = true;
                // `only_…` forbids the turns that are not listed, `no_…` those that are.
                let forbidden = out.iter().filter(|next| listed(next) != *only);
                forbidden.for_each(|&next| builder.forbid(edge, next));
            }
        }
        if !used {
            report.note(ImportNote::RestrictionUnused);
        }
    }
}
