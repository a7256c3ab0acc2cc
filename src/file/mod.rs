//! Trees in files: what all of them share.
//!
//! A file is a header, then plain numbers and arrays of them, one behind the other, the low byte of each first on every
//! machine. Each structure writes and reads itself beside its own code (`layout::wide_file`, `point::…_file`); here are
//! the header ([`header`]), the checksum ([`checksum`]), how numbers become bytes ([`record`]), and the two ends of it:
//! [`Encoder`] and [`Decoder`]. docs/files.md has the table of everything that is in a file.
//!
//! **What is believed when.** A length is believed as far as there are bytes behind it. After the last byte the checksum
//! is compared; a file that was damaged ends there. What is right by its checksum may still say anything, since anybody
//! can compute one: so every structure is then checked for all that queries rely on, before the first of them is
//! answered. A file made to deceive may hold other answers than a build would give, but none that ends in a panic, in an
//! endless loop or in memory that is out of proportion.

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

/// Shorthand for what is wrong with contents.
pub(crate) fn broken<T>(what: &'static str) -> Result<T, FileError> {
    Err(FileError::Broken { what })
}

/// Refuses contents of which something does not hold.
pub(crate) fn require(holds: bool, what: &'static str) -> Result<(), FileError> {
    if holds { Ok(()) } else { broken(what) }
}
