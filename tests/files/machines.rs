//! The same input gives the same file on every machine, whatever its order of bytes, its instruction set and its mathematical
//! library.

use super::support::xxh64;
use super::{points, rays};

#[test]
fn files_have_the_same_bytes_on_every_machine() {
    let rays: Vec<u8> = rays::trees().iter().flat_map(|(_, tree)| rays::file(tree)).collect();
    let points: Vec<u8> = points::trees().iter().flat_map(|(_, tree)| points::file(tree)).collect();
    let found = [xxh64(&rays), xxh64(&points)];
    // Numbers that change with the format of files and with what is built, and with nothing else.
    assert_eq!(found, [0x5c59_632b_9e58_88a9, 0xcccc_c738_8a28_61d6], "{found:#x?}");
}
