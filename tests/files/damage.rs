//! Damaged files: cut off, changed by one byte, of another kind or version.

use super::rays::{file, trees};
use mbkd::{FileError, RayTree};

fn read(bytes: &[u8]) -> Result<RayTree, FileError> {
    RayTree::read_from(&mut &bytes[..])
}

#[test]
fn files_cut_off_anywhere_are_refused() {
    for (name, tree) in trees() {
        let bytes = file(&tree);
        // Every place of small files; of others all beginnings of lines, where arrays begin, and places beside them.
        let step = if bytes.len() < 3000 { 1 } else { 64 };
        for line in (0..bytes.len()).step_by(step) {
            for at in [line, line + 1, line + 31, line + 63].into_iter().filter(|&at| at < bytes.len()) {
                match read(&bytes[..at]) {
                    Err(FileError::Length { .. }) => {}
                    other => panic!("{name}, the first {at} bytes: {other:?}"),
                }
            }
        }
    }
}

#[test]
fn every_single_byte_counts() {
    for (name, tree) in trees().into_iter().take(2) {
        let bytes = file(&tree);
        assert!(bytes.len() < 3000, "{} bytes", bytes.len());
        for at in 0..bytes.len() {
            for bits in 1..=255u8 {
                let mut damaged = bytes.clone();
                damaged[at] ^= bits;
                let Err(error) = read(&damaged) else {
                    panic!("{name}: byte {at} changed by {bits:#x} is not noticed");
                };
                // Damage of contents is called damage.
                assert!(at < 32 || matches!(error, FileError::Checksum { .. }), "{name}, byte {at}: {error}");
            }
        }
    }
}

#[test]
fn files_of_other_kinds_and_versions_are_rejected() {
    let (_, tree) = trees().swap_remove(1);
    let bytes = file(&tree);
    let with = |at: usize, byte: u8| {
        let mut other = bytes.clone();
        other[at] = byte;
        read(&other).unwrap_err()
    };
    assert!(matches!(with(0, b'M'), FileError::NotATree));
    assert!(matches!(with(8, 1), FileError::Version { found: 1, known: 10 }));
    assert!(matches!(with(12, 2), FileError::Kind { .. }));
    assert!(matches!(with(12, 77), FileError::Kind { found: "something unknown", .. }));
    assert!(matches!(with(24, !bytes[24]), FileError::Checksum { .. }));
    assert!(matches!(read(&[]), Err(FileError::Length { .. })));
    for error in [with(0, 0), with(8, 0), with(12, 0), with(24, !bytes[24]), read(&[]).unwrap_err()] {
        assert!(error.to_string().len() > 20);
    }
}

/// A source that gives a byte at a time, and errors in between that mean nothing.
struct Drops<'a>(&'a [u8], bool);

impl std::io::Read for Drops<'_> {
    fn read(&mut self, buffer: &mut [u8]) -> std::io::Result<usize> {
        self.1 = !self.1;
        if self.1 {
            return Err(std::io::ErrorKind::Interrupted.into());
        }
        std::io::Read::read(&mut self.0, &mut buffer[..1])
    }
}

/// A sink that is full after so many bytes.
struct Full(usize);

impl std::io::Write for Full {
    fn write(&mut self, bytes: &[u8]) -> std::io::Result<usize> {
        let some = bytes.len().min(self.0);
        self.0 -= some;
        if some == 0 { Err(std::io::ErrorKind::StorageFull.into()) } else { Ok(some) }
    }
    fn flush(&mut self) -> std::io::Result<()> {
        Ok(())
    }
}

#[test]
fn sources_may_be_slow_and_sinks_may_be_full() {
    let (_, tree) = trees().pop().unwrap();
    let bytes = file(&tree);
    let again = RayTree::read_from(&mut Drops(&bytes, false)).unwrap();
    assert!(file(&again) == bytes);
    for room in [0, 31, 32, 100, bytes.len() - 1] {
        assert!(matches!(tree.write_to(&mut Full(room)), Err(FileError::Io(_))));
    }
    tree.write_to(&mut Full(bytes.len())).unwrap();
}
