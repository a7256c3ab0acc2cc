//! Writing a file.

use super::checksum::Checksum;
use super::error::FileError;
use super::header::{FileKind, HEADER, Header};
use super::record::Record;
use core::sync::atomic::{AtomicU64, Ordering};
use std::fs::File;
use std::io::{ErrorKind, Write};
use std::path::{Path, PathBuf};

/// Arrays begin at multiples of this in a file: a cache line, so that a file can be used where it is mapped.
pub(super) const ALIGNMENT: u64 = 64;

/// Bytes that are encoded at once, few enough to stay in the nearest caches.
const CHUNK: usize = 1 << 15;

/// Writes numbers and arrays.
pub(crate) struct Encoder<'a> {
    /// The destination of the bytes; `None` if they are only counted.
    sink: Option<&'a mut dyn Write>,
    checksum: Checksum,
    /// Number of bytes written so far.
    length: u64,
    chunk: Vec<u8>,
}

/// Writes a file; `contents` writes everything after the header, and the same at each call. It is called twice: first to
/// compute the length and the checksum, which are in the header, without a copy of the whole file in memory.
pub(crate) fn write(
    sink: &mut dyn Write,
    kind: FileKind,
    contents: impl Fn(&mut Encoder<'_>) -> Result<(), FileError>,
) -> Result<(), FileError> {
    let pass = |sink: Option<&mut dyn Write>| {
        let (length, chunk) = (HEADER as u64, vec![0; CHUNK]);
        let mut encoder = Encoder { sink, checksum: Checksum::new(), length, chunk };
        contents(&mut encoder)?;
        Ok::<_, FileError>((encoder.length, encoder.checksum))
    };
    let (length, checksum) = pass(None)?;
    sink.write_all(&Header { kind, length }.to_bytes(checksum))?;
    pass(Some(sink))?;
    Ok(())
}

/// Writes a temporary file by `write` next to `path`, and then renames it: a reader of `path` finds either the previous
/// file or the complete new one, whoever else saves there. The new file has the permissions of the previous one. What is no
/// regular file, as a pipe, is written to directly.
pub(crate) fn save(path: &Path, write: impl FnOnce(&mut dyn Write) -> Result<(), FileError>) -> Result<(), FileError> {
    replace(path, write).map_err(|error| error.at(path))
}

fn replace(path: &Path, write: impl FnOnce(&mut dyn Write) -> Result<(), FileError>) -> Result<(), FileError> {
    let before = std::fs::metadata(path);
    if before.as_ref().is_ok_and(|of| !of.is_file()) {
        return write(&mut File::options().write(true).open(path)?);
    }
    // The file behind a symbolic link, not the link, is replaced.
    let path = std::fs::canonicalize(path).unwrap_or_else(|_| behind_links(path));
    let (part, mut file) = temporary_file(&path, before.is_ok())?;
    if let Ok(before) = before {
        // Where that is refused, as by some file systems of other kinds, less is permitted than before.
        let _ = file.set_permissions(before.permissions());
    }
    // Without the sync, a machine that stops soon afterwards may have the name and not the contents.
    let written = write(&mut file).and_then(|()| Ok(file.sync_all().and_then(|()| std::fs::rename(&part, &path))?));
    if written.is_err() {
        // An error of the removal matters less than the error of the write.
        let _ = std::fs::remove_file(&part);
    }
    written
}

/// The path of a file that does not exist yet, behind symbolic links.
fn behind_links(path: &Path) -> PathBuf {
    let mut path = path.to_path_buf();
    // As many as Linux follows: they may lead in a circle.
    for _ in 0..40 {
        let Ok(next) = std::fs::read_link(&path) else { break };
        path.pop();
        path.push(next);
    }
    path
}

/// Creates a file next to `path` that did not exist: another thread or machine may be saving to the same path. A private one can be
/// opened by nobody else.
fn temporary_file(path: &Path, private: bool) -> std::io::Result<(PathBuf, File)> {
    static COUNT: AtomicU64 = AtomicU64::new(0);
    let mut options = File::options();
    options.write(true).create_new(true);
    #[cfg(unix)]
    if private {
        std::os::unix::fs::OpenOptionsExt::mode(&mut options, 0o600);
    }
    #[cfg(not(unix))]
    let _ = private;
    loop {
        let count = COUNT.fetch_add(1, Ordering::Relaxed);
        let mut name = path.file_name().unwrap_or_default().to_os_string();
        name.push(format!(".{}.{count}.part", std::process::id()));
        let part = path.with_file_name(name);
        match options.open(&part) {
            Err(error) if error.kind() == ErrorKind::AlreadyExists => {}
            created => return Ok((part, created?)),
        }
    }
}

impl Encoder<'_> {
    fn bytes(&mut self, bytes: &[u8]) -> Result<(), FileError> {
        self.length += bytes.len() as u64;
        match &mut self.sink {
            Some(sink) => sink.write_all(bytes)?,
            None => self.checksum.add(bytes),
        }
        Ok(())
    }

    /// Writes one record.
    pub fn put<T: Record>(&mut self, item: T) -> Result<(), FileError> {
        let mut chunk = core::mem::take(&mut self.chunk);
        item.put(&mut chunk[..T::BYTES]);
        let written = self.bytes(&chunk[..T::BYTES]);
        self.chunk = chunk;
        written
    }

    /// Writes the number of items, zeros up to the next cache line, and the items.
    pub fn array<T: Record>(&mut self, items: &[T]) -> Result<(), FileError> {
        self.put(items.len() as u64)?;
        let padding = self.length.next_multiple_of(ALIGNMENT) - self.length;
        self.bytes(&[0; ALIGNMENT as usize][..padding as usize])?;
        let mut chunk = core::mem::take(&mut self.chunk);
        let written = items.chunks(CHUNK / T::BYTES).try_for_each(|items| {
            for (item, to) in items.iter().zip(chunk.chunks_exact_mut(T::BYTES)) {
                item.put(to);
            }
            self.bytes(&chunk[..items.len() * T::BYTES])
        });
        self.chunk = chunk;
        written
    }
}
