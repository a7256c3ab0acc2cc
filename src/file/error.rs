//! Why a tree could not be written to a file or read from one.

use crate::error::BuildError;
use core::fmt;
use std::io;

/// Why saving or loading a tree failed. Nothing that is in a file makes the crate panic: it is one of these.
///
/// ```
/// use mbkd::{FileError, RayTree};
/// let error = RayTree::read_from(&mut &b"no tree at all, but long enough for one"[..]).unwrap_err();
/// assert!(matches!(error, FileError::NotATree));
/// ```
#[derive(Debug)]
#[non_exhaustive]
pub enum FileError {
    /// Reading or writing itself failed.
    Io(io::Error),
    /// The file does not begin as files of this crate do.
    NotATree,
    /// The file is of another version of the format.
    Version {
        /// The file's.
        found: u32,
        /// The one that this version of the crate reads.
        known: u32,
    },
    /// The file holds another kind of tree.
    Kind {
        /// What it holds.
        found: &'static str,
        /// What was to be read.
        expected: &'static str,
    },
    /// The file is shorter or longer than it says.
    Length {
        /// Bytes that it should have.
        expected: u64,
        /// Bytes that it has.
        found: u64,
    },
    /// The bytes are not those that were written.
    Checksum {
        /// Of the bytes that are there.
        found: u64,
        /// Of those that were written.
        expected: u64,
    },
    /// The checksum is right, but the contents are not a tree: the file was made by something else than this crate.
    Broken {
        /// What does not hold.
        what: &'static str,
    },
    /// A file can not hold one of the caller's own shapes in a scene.
    OwnShape {
        /// Its index among the shapes.
        shape: usize,
    },
    /// A lazy tree ([`Policy::Lazy`](crate::Policy::Lazy)) is not written: most of it is not there. A tree of another policy over
    /// the same scene answers alike.
    Lazy,
    /// The primitives handed in at loading are not those that the tree was built of.
    OtherPrimitives {
        /// What differs.
        what: &'static str,
    },
    /// The primitives handed in at loading would be refused by a build.
    Primitives(BuildError),
}

impl fmt::Display for FileError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            FileError::Io(error) => write!(f, "reading or writing failed: {error}"),
            FileError::NotATree => f.write_str("this is not a tree file"),
            FileError::Version { found, known } => {
                write!(
                    f,
                    "the file has version {found} of the format, but version {known} is expected: build the tree again"
                )
            }
            FileError::Kind { found, expected } => write!(f, "the file holds {found}, not {expected}"),
            FileError::Length { expected, found } => {
                write!(
                    f,
                    "the file should have {expected} bytes, but has {found}: it is incomplete or not a single file"
                )
            }
            FileError::Checksum { found, expected } => {
                write!(f, "the file is damaged: its checksum is {found:016x}, not {expected:016x}")
            }
            FileError::Broken { what } => write!(f, "the file does not hold a valid tree: {what}"),
            FileError::OwnShape { shape } => {
                write!(
                    f,
                    "shape {shape} is of the caller's own type, which files cannot store; only spheres can be stored"
                )
            }
            FileError::Lazy => {
                f.write_str("a lazy tree cannot be written to a file: build the same scene with another policy")
            }
            FileError::OtherPrimitives { what } => {
                write!(f, "these are not the primitives that the tree was built of: {what}")
            }
            FileError::Primitives(error) => write!(f, "a given primitive is refused: {error}"),
        }
    }
}

impl std::error::Error for FileError {
    fn source(&self) -> Option<&(dyn std::error::Error + 'static)> {
        match self {
            FileError::Io(error) => Some(error),
            FileError::Primitives(error) => Some(error),
            _ => None,
        }
    }
}

impl From<io::Error> for FileError {
    fn from(error: io::Error) -> FileError {
        FileError::Io(error)
    }
}
