//! Small OpenStreetMap extracts, written by hand.

/// Tags of an element.
pub(crate) type Tags<'a> = &'a [(&'a str, &'a str)];

/// A member of a relation: role, kind (0 for a node, 1 for a way, 2 for a relation), id.
pub(crate) type Member<'a> = (&'a str, u64, i64);

/// Elements of an extract, with one block for each kind.
#[derive(Debug, Clone, Default)]
pub(crate) struct Extract<'a> {
    /// Id, latitude and longitude in 1e-7 degrees.
    pub(crate) nodes: Vec<(i64, i64, i64)>,
    pub(crate) ways: Vec<(i64, &'a [i64], Tags<'a>)>,
    pub(crate) relations: Vec<(Tags<'a>, Vec<Member<'a>>)>,
    /// True to write nodes one by one instead of densely.
    pub(crate) plain_nodes: bool,
    /// True to write the data of blocks as uncompressed blocks of zlib.
    pub(crate) zlib: bool,
}

impl Extract<'_> {
    pub(crate) fn bytes(&self) -> Vec<u8> {
        let mut out = header(&["OsmSchema-V0.6", "DenseNodes"]);
        out.extend(self.block(|group, _| self.write_nodes(group)));
        out.extend(self.block(|group, strings| self.write_ways(group, strings)));
        if !self.relations.is_empty() {
            out.extend(self.block(|group, strings| self.write_relations(group, strings)));
        }
        out
    }

    fn block(&self, write: impl FnOnce(&mut Vec<u8>, &mut Vec<String>)) -> Vec<u8> {
        let (mut group, mut strings) = (Vec::new(), vec![String::new()]);
        write(&mut group, &mut strings);
        let mut table = Vec::new();
        strings.iter().for_each(|text| bytes(&mut table, 1, text.as_bytes()));
        let mut block = Vec::new();
        bytes(&mut block, 1, &table);
        bytes(&mut block, 2, &group);
        if self.zlib { blob("OSMData", 3, &stored(&block)) } else { blob("OSMData", 1, &block) }
    }

    fn write_nodes(&self, group: &mut Vec<u8>) {
        if self.plain_nodes {
            for &(id, latitude, longitude) in &self.nodes {
                let mut node = Vec::new();
                for (field, value) in [(1, id), (8, latitude), (9, longitude)] {
                    varint(&mut node, field << 3);
                    varint(&mut node, zigzag(value));
                }
                bytes(group, 1, &node);
            }
            return;
        }
        let mut dense = Vec::new();
        packed(&mut dense, 1, &deltas(self.nodes.iter().map(|node| node.0)));
        packed(&mut dense, 8, &deltas(self.nodes.iter().map(|node| node.1)));
        packed(&mut dense, 9, &deltas(self.nodes.iter().map(|node| node.2)));
        bytes(group, 2, &dense);
    }

    fn write_ways(&self, group: &mut Vec<u8>, strings: &mut Vec<String>) {
        for &(id, refs, tags) in &self.ways {
            let mut way = Vec::new();
            write_tags(&mut way, id, tags, strings);
            packed(&mut way, 8, &deltas(refs.iter().copied()));
            bytes(group, 3, &way);
        }
    }

    fn write_relations(&self, group: &mut Vec<u8>, strings: &mut Vec<String>) {
        for ((tags, members), id) in self.relations.iter().zip(1..) {
            let mut relation = Vec::new();
            write_tags(&mut relation, id, tags, strings);
            let roles = members.iter().map(|member| number(strings, member.0));
            packed(&mut relation, 8, &roles.collect::<Vec<_>>());
            packed(&mut relation, 9, &deltas(members.iter().map(|member| member.2)));
            packed(&mut relation, 10, &members.iter().map(|member| member.1).collect::<Vec<_>>());
            bytes(group, 4, &relation);
        }
    }
}

pub(crate) fn header(needed: &[&str]) -> Vec<u8> {
    let mut block = Vec::new();
    needed.iter().for_each(|feature| bytes(&mut block, 4, feature.as_bytes()));
    blob("OSMHeader", 1, &block)
}

/// Data in the format of zlib, in one block that is not compressed.
pub(crate) fn stored(data: &[u8]) -> Vec<u8> {
    let length = u16::try_from(data.len()).unwrap();
    let [mut a, mut b] = [1, 0];
    for &byte in data {
        a = (a + u32::from(byte)) % 65_521;
        b = (a + b) % 65_521;
    }
    let (sum, lengths) = (b << 16 | a, [length.to_le_bytes(), (!length).to_le_bytes()].concat());
    [&[0x78, 1, 1][..], &lengths, data, &sum.to_be_bytes()].concat()
}

/// A block with its data in a field: 1 is raw, 3 is zlib, others are other compressions.
pub(crate) fn blob(kind: &str, field: u64, data: &[u8]) -> Vec<u8> {
    let (mut blob, mut head) = (Vec::new(), Vec::new());
    bytes(&mut blob, field, data);
    bytes(&mut head, 1, kind.as_bytes());
    varint(&mut head, 3 << 3);
    varint(&mut head, blob.len() as u64);
    let mut out = (head.len() as u32).to_be_bytes().to_vec();
    out.extend(head);
    out.extend(blob);
    out
}

fn write_tags(out: &mut Vec<u8>, id: i64, tags: Tags<'_>, strings: &mut Vec<String>) {
    varint(out, 1 << 3);
    varint(out, id.cast_unsigned());
    let keys: Vec<u64> = tags.iter().map(|tag| number(strings, tag.0)).collect();
    let values: Vec<u64> = tags.iter().map(|tag| number(strings, tag.1)).collect();
    packed(out, 2, &keys);
    packed(out, 3, &values);
}

/// Index of a text in the string table of a block.
fn number(strings: &mut Vec<String>, text: &str) -> u64 {
    let known = strings.iter().position(|known| known == text);
    known.unwrap_or_else(|| {
        strings.push(text.to_owned());
        strings.len() - 1
    }) as u64
}

fn deltas(values: impl Iterator<Item = i64>) -> Vec<u64> {
    let mut before = 0;
    values.map(|value| zigzag(value - std::mem::replace(&mut before, value))).collect()
}

fn zigzag(value: i64) -> u64 {
    ((value << 1) ^ (value >> 63)).cast_unsigned()
}

fn packed(out: &mut Vec<u8>, field: u64, values: &[u64]) {
    let mut all = Vec::new();
    values.iter().for_each(|&value| varint(&mut all, value));
    bytes(out, field, &all);
}

fn bytes(out: &mut Vec<u8>, field: u64, value: &[u8]) {
    varint(out, field << 3 | 2);
    varint(out, value.len() as u64);
    out.extend(value);
}

fn varint(out: &mut Vec<u8>, mut value: u64) {
    while value >= 0x80 {
        out.push(value as u8 | 0x80);
        value >>= 7;
    }
    out.push(value as u8);
}
