//! Reading a file.

use super::checksum::Checksum;
use super::encoder::ALIGNMENT;
use super::error::FileError;
use super::header::{FileKind, HEADER, Header};
use super::record::Record;
use super::require;
use crate::simd::huge_vec;
use std::fs::File;
use std::io::{self, Read};
use std::path::Path;

/// Bytes that are read at once, few enough to stay in the nearest caches until they are decoded.
const CHUNK: usize = 1 << 16;

/// The largest allocation for an array before its bytes have been read.
const AT_FIRST: usize = 1 << 24;

/// Reads numbers and arrays.
pub(crate) struct Decoder<'a> {
    source: &'a mut dyn Read,
    header: Header,
    /// The checksum according to the header.
    expected: u64,
    /// Whether the length in the header is known to be true.
    whole: bool,
    /// Number of bytes read so far.
    read: u64,
    checksum: Checksum,
    chunk: Vec<u8>,
}

/// Reads a file by its path; `read` gets the bytes and their number.
pub(crate) fn load<T>(
    path: &Path,
    read: impl FnOnce(&mut dyn Read, Option<u64>) -> Result<T, FileError>,
) -> Result<T, FileError> {
    let opened = || {
        let file = File::open(path)?;
        let about = file.metadata()?;
        // Only regular files have a length.
        Ok((file, about.is_file().then_some(about.len())))
    };
    opened().and_then(|(mut file, length)| read(&mut file, length)).map_err(|error| error.at(path))
}

impl<'a> Decoder<'a> {
    /// Reads the header of a file of the expected kind; `length` is that of the whole file, if it is known.
    pub fn begin(source: &'a mut dyn Read, kind: FileKind, length: Option<u64>) -> Result<Decoder<'a>, FileError> {
        let mut bytes = [0; HEADER];
        let found = fill(source, &mut bytes)?;
        if found < HEADER {
            return Err(FileError::Length { expected: length.unwrap_or(0).max(HEADER as u64), found: found as u64 });
        }
        let (header, expected) = Header::of_bytes(&bytes, kind)?;
        match length {
            Some(found) if found != header.length => {
                return Err(FileError::Length { expected: header.length, found });
            }
            _ if header.length < HEADER as u64 => {
                return Err(FileError::Length { expected: header.length, found: HEADER as u64 });
            }
            _ => {}
        }
        let (read, checksum, chunk) = (HEADER as u64, Checksum::new(), vec![0; CHUNK]);
        Ok(Decoder { source, header, expected, whole: length.is_some(), read, checksum, chunk })
    }

    /// Reads a whole file: `raw` decodes everything after the header without validating it; `checked` makes a tree of it
    /// once the checksum has shown that the bytes are those that were written.
    pub fn whole<R, T>(
        mut self,
        raw: impl FnOnce(&mut Decoder<'_>) -> Result<R, FileError>,
        checked: impl FnOnce(R) -> Result<T, FileError>,
    ) -> Result<T, FileError> {
        let raw = raw(&mut self);
        match raw {
            Err(FileError::Io(_) | FileError::Length { .. }) => {}
            // A damaged length shows up as another error. So the rest is read and the checksum is compared first.
            _ => self.finish()?,
        }
        checked(raw?)
    }

    /// Reads the rest and compares the checksum.
    fn finish(&mut self) -> Result<(), FileError> {
        let left = self.left();
        while self.left() > 0 {
            let some = self.left().min(CHUNK as u64) as usize;
            self.chunk(some)?;
        }
        let behind = core::mem::replace(&mut self.checksum, Checksum::new());
        let (found, expected) = (self.header.checksum(behind), self.expected);
        if found != expected {
            return Err(FileError::Checksum { found, expected });
        }
        require(left == 0, "it contains more than a tree")
    }

    /// Number of bytes not read yet.
    fn left(&self) -> u64 {
        self.header.length - self.read
    }

    /// Reads the next bytes, at most as many as fit into a chunk.
    fn chunk(&mut self, bytes: usize) -> Result<&[u8], FileError> {
        require(bytes as u64 <= self.left(), "something in it is longer than the whole")?;
        let chunk = &mut self.chunk[..bytes];
        let found = fill(self.source, chunk)?;
        if found < bytes {
            return Err(FileError::Length { expected: self.header.length, found: self.read + found as u64 });
        }
        self.checksum.add(chunk);
        self.read += bytes as u64;
        Ok(chunk)
    }

    /// Reads one record.
    pub fn get<T: Record>(&mut self) -> Result<T, FileError> {
        Ok(T::get(self.chunk(T::BYTES)?))
    }

    /// Begins an array: returns the number of its items, which the rest of the file is long enough for.
    pub fn count<T: Record>(&mut self) -> Result<usize, FileError> {
        let count = self.get::<u64>()?;
        let padding = self.read.next_multiple_of(ALIGNMENT) - self.read;
        let zeros = self.chunk(padding as usize)?.iter().all(|&byte| byte == 0);
        require(zeros, "there is something in front of an array")?;
        require(count <= self.left() / T::BYTES as u64, "an array is longer than the whole")?;
        usize::try_from(count).map_err(|_| FileError::Broken { what: "an array is too long for this machine" })
    }

    /// The number of items of an array to allocate room for before they are read: all of them if the bytes are known
    /// to exist, at most a few megabytes otherwise.
    pub fn room<T: Record>(&self, count: usize) -> usize {
        if self.whole { count } else { count.min(AT_FIRST / T::BYTES) }
    }

    /// Reads `count` items of an array and appends them.
    pub fn items<T: Record>(&mut self, count: usize, to: &mut impl Extend<T>) -> Result<(), FileError> {
        let mut left = count;
        while left > 0 {
            let some = left.min(CHUNK / T::BYTES);
            to.extend(self.chunk(some * T::BYTES)?.chunks_exact(T::BYTES).map(T::get));
            left -= some;
        }
        Ok(())
    }

    /// Reads an array.
    pub fn array<T: Record>(&mut self) -> Result<Vec<T>, FileError> {
        let count = self.count::<T>()?;
        let mut items = huge_vec(self.room::<T>(count));
        self.items::<T>(count, &mut items)?;
        Ok(items)
    }
}

/// Reads until a buffer is full or the source ends, and returns the number of bytes read.
fn fill(source: &mut dyn Read, mut buffer: &mut [u8]) -> Result<usize, FileError> {
    let mut found = 0;
    while !buffer.is_empty() {
        match source.read(buffer) {
            Ok(0) => break,
            Ok(n) => {
                // Not more than the buffer holds, whatever a custom reader returns.
                let n = n.min(buffer.len());
                found += n;
                buffer = &mut buffer[n..];
            }
            Err(error) if error.kind() == io::ErrorKind::Interrupted => {}
            Err(error) => return Err(error.into()),
        }
    }
    Ok(found)
}
