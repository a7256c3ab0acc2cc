//! Errors of saving and loading trees.

use crate::error::BuildError;
use core::fmt;
use std::io;
use std::path::{Path, PathBuf};

/// Why saving or loading a tree failed. No contents of a file make the crate panic; it returns this error.
///
/// Errors of `save` and `load` name the file ([`FileError::At`]); [`FileError::cause`] is what is wrong, with or without a name.
///
/// ```
/// use mbkd::{FileError, RayTree};
/// let error = RayTree::read_from(&mut &b"no tree at all, but long enough for one"[..]).unwrap_err();
/// assert!(matches!(error, FileError::NotATree));
/// let error = RayTree::load("not/there.tree").unwrap_err();
/// assert!(matches!(error.cause(), FileError::Io(_)));
/// assert!(error.to_string().starts_with("not/there.tree: "));
/// ```
#[derive(Debug)]
#[non_exhaustive]
pub enum FileError {
    /// Reading or writing itself failed.
    Io(io::Error),
    /// The file does not begin like files of this crate.
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
        /// The kind in the file.
        found: &'static str,
        /// The expected kind.
        expected: &'static str,
    },
    /// The file is shorter or longer than its header says.
    Length {
        /// Bytes that it should have.
        expected: u64,
        /// Bytes that it has.
        found: u64,
    },
    /// The bytes differ from those that were written.
    Checksum {
        /// The checksum of the bytes in the file.
        found: u64,
        /// The checksum of the bytes that were written.
        expected: u64,
    },
    /// The checksum is right, but the contents are not a valid tree: the file was not made by this crate.
    Broken {
        /// The condition that does not hold.
        what: &'static str,
    },
    /// The tree has custom primitives, which are not in the file:
    /// [`RayTree::load_with_shapes`](crate::RayTree::load_with_shapes) takes them.
    CustomShapes {
        /// Their number.
        custom: usize,
    },
    /// A lazy tree ([`Policy::Lazy`](crate::Policy::Lazy)) cannot be written: most of it is not built yet. A tree of another policy
    /// over the same scene gives the same answers.
    Lazy,
    /// The shapes passed to loading are not those that the tree was built of.
    OtherShapes {
        /// The property that differs.
        what: &'static str,
    },
    /// The shapes passed to loading would be rejected by a build.
    Shapes(BuildError),
    /// What is wrong with a file that was given by its path.
    At {
        /// The path as it was given.
        path: PathBuf,
        /// What is wrong; not another `At`.
        error: Box<FileError>,
    },
}

impl FileError {
    /// What is wrong, without the path: the error in [`FileError::At`], and any other error itself.
    pub fn cause(&self) -> &FileError {
        match self {
            FileError::At { error, .. } => error,
            error => error,
        }
    }

    /// The error of the file at a path.
    pub(super) fn at(self, path: &Path) -> FileError {
        FileError::At { path: path.to_owned(), error: Box::new(self) }
    }
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
            FileError::CustomShapes { custom } => {
                write!(
                    f,
                    "{custom} of the shapes are custom primitives, which are not in the file: load it with all shapes"
                )
            }
            FileError::Lazy => {
                f.write_str("a lazy tree cannot be written to a file: build the same scene with another policy")
            }
            FileError::OtherShapes { what } => {
                write!(f, "these are not the shapes that the tree was built of: {what} differ")
            }
            FileError::Shapes(error) => write!(f, "a shape is rejected: {error}"),
            FileError::At { path, error } => write!(f, "{}: {error}", path.display()),
        }
    }
}

// Like the other errors of this crate, it prints the errors in it, and so does not return them as a source.
impl std::error::Error for FileError {}

impl From<io::Error> for FileError {
    fn from(error: io::Error) -> FileError {
        FileError::Io(error)
    }
}
