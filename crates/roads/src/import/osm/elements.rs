//! Nodes, ways and relations of a block, decoded from their messages.
//!
//! Elements refer to strings of their block by index, and store ids and coordinates as differences
//! in integer units. All of these come from outside, so indices are looked up and sums checked.

use super::wire::{OUT_OF_RANGE, Value, each_field, sums};

/// A block of data: its groups of elements and what they share.
#[derive(Debug)]
pub(super) struct Block<'a> {
    strings: Vec<&'a [u8]>,
    groups: Vec<&'a [u8]>,
    /// Nanodegrees per unit of a coordinate.
    granularity: i64,
    /// Offsets of latitude and longitude in nanodegrees.
    offsets: [i64; 2],
}

/// Message of an element of a block.
#[derive(Debug, Clone, Copy)]
pub(super) enum Element<'a> {
    Node(&'a [u8]),
    /// Many nodes, column by column.
    Nodes(&'a [u8]),
    Way(&'a [u8]),
    Relation(&'a [u8]),
}

/// A way: its tags as indices of strings, and its nodes.
#[derive(Debug, Default)]
pub(super) struct Way {
    pub(super) id: i64,
    pub(super) tags: Tags,
    refs: Vec<u64>,
}

/// A relation: its tags as indices of strings, and its members.
#[derive(Debug, Default)]
pub(super) struct Relation {
    pub(super) tags: Tags,
    roles: Vec<u64>,
    ids: Vec<u64>,
    kinds: Vec<u64>,
}

/// Keys and values of tags, as indices of strings.
#[derive(Debug, Default)]
pub(super) struct Tags {
    keys: Vec<u64>,
    values: Vec<u64>,
}

/// Kind of a member of a relation.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Member {
    Node,
    Way,
    Relation,
}

impl<'a> Block<'a> {
    pub(super) fn parse(message: &'a [u8]) -> Result<Self, String> {
        let (strings, groups) = (Vec::new(), Vec::new());
        // Defaults of the format.
        let mut block = Self { strings, groups, granularity: 100, offsets: [0; 2] };
        each_field(message, |field, value| {
            match field {
                1 => each_field(value.bytes()?, |field, text| {
                    if field == 1 {
                        block.strings.push(text.bytes()?);
                    }
                    Ok(())
                })?,
                2 => block.groups.push(value.bytes()?),
                // These fields may follow the groups, so groups are only decoded once the whole
                // block has been read.
                17 => block.granularity = value.number()?.cast_signed(),
                19 => block.offsets[0] = value.number()?.cast_signed(),
                20 => block.offsets[1] = value.number()?.cast_signed(),
                _ => {}
            }
            Ok(())
        })?;
        Ok(block)
    }

    /// Visits the elements of all groups.
    pub(super) fn each_element(
        &self,
        mut visit: impl FnMut(Element<'a>) -> Result<(), String>,
    ) -> Result<(), String> {
        let mut visit = |field, value: Value<'a>| match field {
            1 => visit(Element::Node(value.bytes()?)),
            2 => visit(Element::Nodes(value.bytes()?)),
            3 => visit(Element::Way(value.bytes()?)),
            4 => visit(Element::Relation(value.bytes()?)),
            _ => Ok(()),
        };
        self.groups.iter().try_for_each(|group| each_field(group, &mut visit))
    }

    /// Visits the node of a message, with its latitude and longitude in nanodegrees.
    pub(super) fn node(
        &self,
        message: &[u8],
        visit: &mut impl FnMut(i64, [i64; 2]) -> Result<(), String>,
    ) -> Result<(), String> {
        let (mut id, mut place) = (0, [0; 2]);
        each_field(message, |field, value| {
            match field {
                1 => id = value.signed()?,
                8 => place[0] = value.signed()?,
                9 => place[1] = value.signed()?,
                _ => {}
            }
            Ok(())
        })?;
        visit(id, self.nanodegrees(place)?)
    }

    /// Visits the nodes of a message of many, as [`node`](Self::node).
    pub(super) fn nodes(
        &self,
        message: &[u8],
        visit: &mut impl FnMut(i64, [i64; 2]) -> Result<(), String>,
    ) -> Result<(), String> {
        let [mut ids, mut latitudes, mut longitudes] = [const { Vec::new() }; 3];
        each_field(message, |field, value| match field {
            1 => value.add_to(&mut ids),
            8 => value.add_to(&mut latitudes),
            9 => value.add_to(&mut longitudes),
            _ => Ok(()),
        })?;
        let (count, found) = (ids.len(), [latitudes.len(), longitudes.len()]);
        if found != [count; 2] {
            let [latitudes, longitudes] = found;
            return Err(format!(
                "{count} nodes with {latitudes} latitudes and {longitudes} longitudes, expected one each"
            ));
        }
        // Each column is delta coded, from 0 at its start.
        for ((id, latitude), longitude) in sums(&ids).zip(sums(&latitudes)).zip(sums(&longitudes)) {
            visit(id?, self.nanodegrees([latitude?, longitude?])?)?;
        }
        Ok(())
    }

    fn nanodegrees(&self, place: [i64; 2]) -> Result<[i64; 2], String> {
        let of = |axis: usize| {
            let scaled = self.granularity.checked_mul(place[axis]);
            scaled.and_then(|scaled| scaled.checked_add(self.offsets[axis])).ok_or(OUT_OF_RANGE)
        };
        Ok([of(0)?, of(1)?])
    }

    /// Keys and values of tags as text.
    pub(super) fn tags(&self, tags: &Tags) -> Result<Vec<(&'a str, &'a str)>, String> {
        let Tags { keys, values } = tags;
        if keys.len() != values.len() {
            let [keys, values] = [keys.len(), values.len()];
            return Err(format!("{keys} keys of tags and {values} values, expected one each"));
        }
        keys.iter()
            .zip(values)
            .map(|(&key, &value)| Ok((self.text(key)?, self.text(value)?)))
            .collect()
    }

    /// True if a key is among tags.
    pub(super) fn has_key(&self, tags: &Tags, key: &str) -> bool {
        // Compared as bytes, so that invalid text in a way that is skipped does not fail the block.
        let is_key = |&index: &u64| self.string(index) == Some(key.as_bytes());
        tags.keys.iter().any(is_key)
    }

    fn string(&self, index: u64) -> Option<&'a [u8]> {
        usize::try_from(index).ok().and_then(|index| self.strings.get(index).copied())
    }

    fn text(&self, index: u64) -> Result<&'a str, String> {
        let count = self.strings.len();
        let bytes = self.string(index).ok_or_else(|| format!("string {index}, of {count}"))?;
        std::str::from_utf8(bytes).map_err(|error| format!("string {index}: {error}"))
    }

    /// Members of a relation: role, kind and id.
    pub(super) fn members(
        &self,
        relation: &Relation,
    ) -> Result<Vec<(&'a str, Member, i64)>, String> {
        let Relation { roles, ids, kinds, .. } = relation;
        if [ids.len(), kinds.len()] != [roles.len(); 2] {
            let [roles, ids, kinds] = [roles.len(), ids.len(), kinds.len()];
            return Err(format!(
                "{roles} roles of members, {ids} ids and {kinds} kinds, expected one each"
            ));
        }
        let all = roles.iter().zip(sums(ids)).zip(kinds);
        let members = all.map(|((&role, id), &kind)| {
            let kind = match kind {
                0 => Member::Node,
                1 => Member::Way,
                2 => Member::Relation,
                _ => return Err(format!("a member of kind {kind}, expected 0 to 2")),
            };
            Ok((self.text(role)?, kind, id?))
        });
        members.collect()
    }
}

impl Tags {
    /// Takes a field of an element if it holds keys or values.
    fn take(&mut self, field: u64, value: Value<'_>) -> Result<(), String> {
        match field {
            2 => value.add_to(&mut self.keys),
            3 => value.add_to(&mut self.values),
            _ => Ok(()),
        }
    }
}

impl Way {
    pub(super) fn parse(message: &[u8]) -> Result<Self, String> {
        let mut way = Self::default();
        each_field(message, |field, value| match field {
            1 => {
                way.id = value.number()?.cast_signed();
                Ok(())
            }
            8 => value.add_to(&mut way.refs),
            _ => way.tags.take(field, value),
        })?;
        Ok(way)
    }

    /// Ids of the nodes of the way.
    pub(super) fn nodes(&self) -> impl Iterator<Item = Result<i64, String>> {
        sums(&self.refs)
    }
}

impl Relation {
    pub(super) fn parse(message: &[u8]) -> Result<Self, String> {
        let mut relation = Self::default();
        each_field(message, |field, value| match field {
            8 => value.add_to(&mut relation.roles),
            9 => value.add_to(&mut relation.ids),
            10 => value.add_to(&mut relation.kinds),
            _ => relation.tags.take(field, value),
        })?;
        Ok(relation)
    }
}
