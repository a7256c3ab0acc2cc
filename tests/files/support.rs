//! An independent implementation of the checksum of files, mutations of files, and what reads mutated files.

pub use crate::scene::Random;
use mbkd::FileError;
use std::panic::RefUnwindSafe;

/// Bytes of the header, and the offsets of the length and the checksum in it.
pub const HEADER: usize = 32;
pub const LENGTH_AT: usize = 16;
pub const CHECKSUM_AT: usize = 24;

/// XXH64 with seed 0.
pub fn xxh64(bytes: &[u8]) -> u64 {
    const P: [u64; 5] =
        [11400714785074694791, 14029467366897019727, 1609587929392839161, 9650029242287828579, 2870177450012600261];
    let word = |b: &[u8]| b.iter().rev().fold(0u64, |w, &x| w << 8 | u64::from(x));
    let round = |a: u64, w: u64| a.wrapping_add(w.wrapping_mul(P[1])).rotate_left(31).wrapping_mul(P[0]);
    let whole = bytes.len() / 32 * 32;
    let mut h = P[4];
    if whole > 0 {
        let mut v = [P[0].wrapping_add(P[1]), P[1], 0, P[0].wrapping_neg()];
        for (i, w) in bytes[..whole].chunks(8).enumerate() {
            v[i % 4] = round(v[i % 4], word(w));
        }
        h = (0..4).fold(0u64, |h, i| h.wrapping_add(v[i].rotate_left([1, 7, 12, 18][i])));
        for v in v {
            h = (h ^ round(0, v)).wrapping_mul(P[0]).wrapping_add(P[3]);
        }
    }
    h = h.wrapping_add(bytes.len() as u64);
    let mut rest = &bytes[whole..];
    while rest.len() >= 8 {
        h = (h ^ round(0, word(&rest[..8]))).rotate_left(27).wrapping_mul(P[0]).wrapping_add(P[3]);
        rest = &rest[8..];
    }
    if rest.len() >= 4 {
        h = (h ^ word(&rest[..4]).wrapping_mul(P[0])).rotate_left(23).wrapping_mul(P[1]).wrapping_add(P[2]);
        rest = &rest[4..];
    }
    for &b in rest {
        h = (h ^ u64::from(b).wrapping_mul(P[4])).rotate_left(11).wrapping_mul(P[0]);
    }
    h = (h ^ h >> 33).wrapping_mul(P[1]);
    h = (h ^ h >> 29).wrapping_mul(P[2]);
    h ^ h >> 32
}

/// Corrects the length and the checksum of a file.
pub fn seal(file: &mut [u8]) {
    let length = file.len() as u64;
    file[LENGTH_AT..CHECKSUM_AT].copy_from_slice(&length.to_le_bytes());
    let of = [&file[HEADER..], &file[..CHECKSUM_AT]].concat();
    let checksum = xxh64(&of);
    file[CHECKSUM_AT..HEADER].copy_from_slice(&checksum.to_le_bytes());
}

/// Mutates a file in plausible ways, and corrects its length and checksum.
pub fn mutate(file: &[u8], random: &mut Random) -> Vec<u8> {
    let mut file = file.to_vec();
    for _ in 0..1 + random.below(3) {
        // Whole words only: the file may have been cut off.
        let left = (file.len() - HEADER) / 4 * 4;
        if left < 8 {
            break;
        }
        // Bytes at the begin matter more than those in the middle of long arrays.
        let at = match random.below(3) {
            0 => HEADER + random.below(left.min(512)),
            _ => HEADER + random.below(left),
        };
        let word = at / 4 * 4;
        match random.below(8) {
            0 => file[at] ^= 1 << random.below(8),
            1 => file[at] = random.bits() as u8,
            2 => {
                let values =
                    [0, 1, 2, u32::MAX, u32::MAX - 1, 0x7fc0_0000, 0x7f80_0000, 0xff80_0000, 1 << 31, 0x3f80_0000];
                let value = values[random.below(values.len())];
                file[word..word + 4].copy_from_slice(&value.to_le_bytes());
            }
            3 => {
                let value = random.bits() as u32 >> random.below(32);
                file[word..word + 4].copy_from_slice(&value.to_le_bytes());
            }
            4 => {
                let from = (HEADER + random.below(left)) / 4 * 4;
                let value: [u8; 4] = file[from..from + 4].try_into().unwrap();
                file[word..word + 4].copy_from_slice(&value);
            }
            5 => {
                let value = u32::from_le_bytes(file[word..word + 4].try_into().unwrap());
                let by = (1u32 << random.below(32)).wrapping_mul([1, u32::MAX][random.below(2)]);
                file[word..word + 4].copy_from_slice(&value.wrapping_add(by).to_le_bytes());
            }
            6 if file.len() >= 64 => {
                // Copies one line of an array over another.
                let lines = file.len() / 64;
                let (from, to) = (random.below(lines) * 64, random.below(lines) * 64);
                if to >= HEADER {
                    let line = file[from..from + 64].to_vec();
                    file[to..to + 64].copy_from_slice(&line);
                }
            }
            _ if random.below(4) == 0 => file.truncate(at),
            _ => file[at] = file[at].wrapping_add(1),
        }
    }
    seal(&mut file);
    file
}

/// Rounds of mutations for each tree; more in a longer search by `MBKD_FILE_ROUNDS`.
pub fn rounds() -> u64 {
    std::env::var("MBKD_FILE_ROUNDS").ok().and_then(|rounds| rounds.parse().ok()).unwrap_or(200)
}

/// Whether an error says that the contents of a file describe no tree.
pub fn is_broken(error: &FileError) -> bool {
    matches!(error, FileError::Broken { .. } | FileError::Length { .. })
}

/// Reads mutations of a file, with a right checksum and wrong contents, and runs queries on the trees; counts those that are
/// refused and those that are answered from.
pub fn hostile<T>(
    (name, number): (&str, usize),
    bytes: &[u8],
    rounds: u64,
    counts: &mut [usize; 2],
    read: impl Fn(&[u8]) -> Result<T, FileError> + RefUnwindSafe,
    refused: fn(&FileError) -> bool,
    run_queries: impl Fn(T, u64) + RefUnwindSafe,
) {
    for round in 0..rounds {
        let seed = (number as u64) << 32 | round;
        let hostile = mutate(bytes, &mut Random(seed));
        let outcome = std::panic::catch_unwind(|| match read(&hostile) {
            Ok(tree) => {
                run_queries(tree, seed);
                1
            }
            Err(error) if refused(&error) => 0,
            Err(error) => panic!("{error}"),
        });
        match outcome {
            Ok(kind) => counts[kind] += 1,
            Err(_) => panic!("{name}: seed {seed:#x}"),
        }
    }
}
