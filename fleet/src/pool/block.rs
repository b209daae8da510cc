//! Blocks of a snapshot, and the fields in them; see [`file`](super::file) for the format.

use std::fs::File;
use std::io::{self, BufReader, Read};
use std::path::Path;

use twox_hash::XxHash3_64;
use wayfix::inference::FilterSnapshot;

use super::VehicleId;
use crate::error::{FleetError, Outcome};

/// A block of vehicles.
#[derive(Debug)]
pub(super) struct Block {
    pub(super) vehicles: u32,
    /// Encoded vehicles; in a block to be written also the head, and once sealed the checksum.
    pub(super) bytes: Vec<u8>,
}

/// Size of the head of a block in bytes.
const HEAD: usize = 12;

impl Block {
    pub(super) fn new() -> Self {
        Self { vehicles: 0, bytes: vec![0; HEAD] }
    }

    /// Adds a vehicle.
    pub(super) fn push(&mut self, vehicle: &VehicleId, time: i64, state: &FilterSnapshot) {
        let bytes = &mut self.bytes;
        match vehicle {
            VehicleId::Number(number) => {
                bytes.push(0);
                bytes.extend(number.to_le_bytes());
            }
            VehicleId::Text(text) => {
                bytes.push(1);
                bytes.extend((text.len() as u32).to_le_bytes());
                bytes.extend(text.as_bytes());
            }
        }
        bytes.extend(time.to_le_bytes());
        let state = state.to_bytes();
        bytes.extend((state.len() as u32).to_le_bytes());
        bytes.extend(state);
        self.vehicles += 1;
    }

    /// Appends the vehicles of another block.
    pub(super) fn append(&mut self, other: &Self) {
        self.bytes.extend(&other.bytes[HEAD..]);
        self.vehicles += other.vehicles;
    }

    /// Bytes of the vehicles, without the head.
    pub(super) fn length(&self) -> usize {
        self.bytes.len() - HEAD
    }

    /// Fills in the head and appends the checksum; returns all bytes of block `number`.
    pub(super) fn seal(&mut self, number: u64) -> &[u8] {
        let length = (self.bytes.len() - HEAD) as u64;
        self.bytes[..4].copy_from_slice(&self.vehicles.to_le_bytes());
        self.bytes[4..HEAD].copy_from_slice(&length.to_le_bytes());
        // The block's number is the seed, so blocks that are swapped, repeated or missing are
        // detected.
        let sum = XxHash3_64::oneshot_with_seed(number, &self.bytes);
        self.bytes.extend(sum.to_le_bytes());
        &self.bytes
    }
}

/// A snapshot that is being read.
pub(super) struct Source<'a> {
    file: BufReader<File>,
    pub(super) path: &'a Path,
    /// Bytes left in the file: a damaged length must not lead to a huge allocation.
    pub(super) left: u64,
}

impl<'a> Source<'a> {
    pub(super) fn open(path: &'a Path) -> Outcome<Self> {
        let file = File::open(path).map_err(FleetError::file(path))?;
        let left = file.metadata().map_err(FleetError::file(path))?.len();
        Ok(Self { file: BufReader::new(file), path, left })
    }

    pub(super) fn bytes(&mut self, count: u64) -> Outcome<Vec<u8>> {
        if count > self.left {
            return Err(FleetError::format(self.path, "damaged: the end is missing"));
        }
        let mut bytes = vec![0; count as usize];
        self.file.read_exact(&mut bytes).map_err(|error| match error.kind() {
            io::ErrorKind::UnexpectedEof => FleetError::format(self.path, "damaged: cut off"),
            _ => FleetError::file(self.path)(error),
        })?;
        self.left -= count;
        Ok(bytes)
    }

    pub(super) fn check(&mut self, sum: u64, part: &str) -> Outcome<()> {
        if self.bytes(8)? == sum.to_le_bytes() {
            return Ok(());
        }
        Err(FleetError::format(self.path, format!("damaged: the checksum of {part} is wrong")))
    }

    /// Reads block `number`, without its head.
    pub(super) fn block(&mut self, number: u64) -> Outcome<Block> {
        let head = self.bytes(HEAD as u64)?;
        let mut fields = Fields { bytes: &head };
        let (Some(vehicles), Some(length)) = (fields.u32(), fields.u64()) else {
            return Err(FleetError::format(self.path, "damaged: cut off"));
        };
        let bytes = self.bytes(length)?;
        let mut hasher = XxHash3_64::with_seed(number);
        std::hash::Hasher::write(&mut hasher, &head);
        std::hash::Hasher::write(&mut hasher, &bytes);
        self.check(std::hash::Hasher::finish(&hasher), &format!("block {number}"))?;
        Ok(Block { vehicles, bytes })
    }
}

/// Reads fields from the bytes of a block or header; `None` where they end too soon.
pub(super) struct Fields<'a> {
    pub(super) bytes: &'a [u8],
}

impl<'a> Fields<'a> {
    pub(super) fn take(&mut self, count: usize) -> Option<&'a [u8]> {
        let (taken, rest) = self.bytes.split_at_checked(count)?;
        self.bytes = rest;
        Some(taken)
    }

    pub(super) fn array<const N: usize>(&mut self) -> Option<[u8; N]> {
        self.take(N)?.try_into().ok()
    }

    pub(super) fn u32(&mut self) -> Option<u32> {
        self.array().map(u32::from_le_bytes)
    }

    pub(super) fn u64(&mut self) -> Option<u64> {
        self.array().map(u64::from_le_bytes)
    }

    pub(super) fn i64(&mut self) -> Option<i64> {
        self.array().map(i64::from_le_bytes)
    }

    /// Reads the id, the time and the bytes of the state of a vehicle.
    pub(super) fn vehicle(&mut self) -> Option<(VehicleId, i64, &'a [u8])> {
        let vehicle = match self.array()? {
            [0] => VehicleId::Number(self.i64()?),
            [1] => {
                let length = self.u32()? as usize;
                VehicleId::from(std::str::from_utf8(self.take(length)?).ok()?)
            }
            _ => return None,
        };
        let time = self.i64()?;
        let length = self.u32()? as usize;
        Some((vehicle, time, self.take(length)?))
    }
}
