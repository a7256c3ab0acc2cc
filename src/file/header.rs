//! The header of a file.

use super::checksum::Checksum;
use super::error::FileError;
use super::record::Record;

/// The first bytes of every file. Like those of PNG they reveal a transfer in text mode: they contain the line ends and the
/// end-of-file mark of two systems.
const MAGIC: [u8; 8] = *b"mbkd\r\n\x1a\n";

/// The version of the format that is written, and the only one that can be read.
const VERSION: u32 = 10;

/// Bytes of the header.
pub(super) const HEADER: usize = 32;

/// The offset of the checksum, which does not cover itself.
const CHECKSUM_AT: usize = 24;

/// The kind of tree in a file.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum FileKind {
    /// A `RayTree`.
    Rays = 1,
    /// A `PointTree`.
    Points = 2,
}

impl FileKind {
    fn of(number: u32) -> Option<FileKind> {
        [FileKind::Rays, FileKind::Points].into_iter().find(|&kind| kind as u32 == number)
    }

    fn name(self) -> &'static str {
        match self {
            FileKind::Rays => "a ray tree",
            FileKind::Points => "a point tree",
        }
    }
}

/// A header without its checksum.
pub(super) struct Header {
    pub kind: FileKind,
    /// Bytes of the whole file.
    pub length: u64,
}

impl Header {
    /// The bytes before the checksum.
    fn front(&self) -> [u8; CHECKSUM_AT] {
        let mut bytes = [0; CHECKSUM_AT];
        bytes[..8].copy_from_slice(&MAGIC);
        VERSION.put(&mut bytes[8..12]);
        (self.kind as u32).put(&mut bytes[12..16]);
        self.length.put(&mut bytes[16..]);
        bytes
    }

    /// The checksum of a file: of the bytes after the header, which is given, and then of those before the checksum.
    pub fn checksum(&self, mut behind: Checksum) -> u64 {
        behind.add(&self.front());
        behind.value()
    }

    /// The bytes of the header, given the checksum of the bytes after it.
    pub fn to_bytes(&self, behind: Checksum) -> [u8; HEADER] {
        let mut bytes = [0; HEADER];
        bytes[..CHECKSUM_AT].copy_from_slice(&self.front());
        self.checksum(behind).put(&mut bytes[CHECKSUM_AT..]);
        bytes
    }

    /// Decodes the header of a file of the expected kind, and the checksum in it.
    pub fn of_bytes(bytes: &[u8; HEADER], expected: FileKind) -> Result<(Header, u64), FileError> {
        if bytes[..8] != MAGIC {
            return Err(FileError::NotATree);
        }
        let version = u32::get(&bytes[8..12]);
        if version != VERSION {
            return Err(FileError::Version { found: version, known: VERSION });
        }
        match FileKind::of(u32::get(&bytes[12..16])) {
            Some(kind) if kind == expected => {
                Ok((Header { kind, length: u64::get(&bytes[16..CHECKSUM_AT]) }, u64::get(&bytes[CHECKSUM_AT..])))
            }
            kind => {
                let found = kind.map_or("something unknown", FileKind::name);
                Err(FileError::Kind { found, expected: expected.name() })
            }
        }
    }
}
