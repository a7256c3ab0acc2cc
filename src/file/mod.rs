//! Saving and loading trees: the parts that all file formats share.
//!
//! A file is a header, then plain numbers and arrays of them without gaps, little-endian on every
//! machine. Each structure encodes and decodes itself next to its own code (`layout::wide_file`, `point::…_file`); this
//! module has the header ([`header`]), the checksum ([`checksum`]), the conversion of numbers to bytes ([`record`]), and
//! [`Encoder`] and [`Decoder`]. docs/files.md has the table of all contents of a file.
//!
//! **Validation.** A length is trusted only as far as the file has bytes for it. After the last byte the checksum
//! is compared, which rejects damaged files. Contents with a valid checksum may still be arbitrary, since anybody
//! can compute one: so every structure is then validated for all invariants that queries rely on, before the first query.
//! A forged file may give other answers than a build would, but no panic, no endless loop and no allocation out of
//! proportion to its size.

mod checksum;
mod decoder;
mod encoder;
mod error;
mod header;
mod record;

pub(crate) use decoder::{Decoder, load};
pub(crate) use encoder::{Encoder, save, write};
pub use error::FileError;
pub(crate) use header::FileKind;
pub(crate) use record::{Record, record_fields};

/// An error for invalid contents.
pub(crate) fn broken<T>(what: &'static str) -> Result<T, FileError> {
    Err(FileError::Broken { what })
}

/// Returns an error for contents unless a condition holds.
pub(crate) fn require(holds: bool, what: &'static str) -> Result<(), FileError> {
    if holds { Ok(()) } else { broken(what) }
}
