//! The checksum of files: XXH64, by Yann Collet.
//!
//! It has to detect damage (bit errors on a disk, truncated or mixed-up files), at the speed of memory, in a few lines of
//! plain code. CRC-32 is as well known, but takes a table lookup per byte or instructions that not every machine has,
//! and misses one error in four billion; XXH64 reads eight bytes in each of four independent lanes, has 64 bits, and a
//! public description with test values. A cryptographic hash would be ten times slower and of no use: whoever forges a
//! file also computes its checksum, and so contents are validated in any case.
//!
//! Source: "xxHash fast digest algorithm", version 0.1.1, of the project xxHash.

const PRIME_1: u64 = 0x9E37_79B1_85EB_CA87;
const PRIME_2: u64 = 0xC2B2_AE3D_27D4_EB4F;
const PRIME_3: u64 = 0x1656_67B1_9E37_79F9;
const PRIME_4: u64 = 0x85EB_CA77_C2B2_AE63;
const PRIME_5: u64 = 0x27D4_EB2F_1656_67C5;

/// Bytes that are processed at once: eight for each lane.
const STRIPE: usize = 32;

/// The checksum of a stream of bytes, with seed 0.
pub(crate) struct Checksum {
    lanes: [u64; 4],
    /// Buffered bytes of an incomplete stripe.
    rest: [u8; STRIPE],
    total: u64,
}

impl Checksum {
    /// The checksum of no bytes.
    pub fn new() -> Checksum {
        let lanes = [PRIME_1.wrapping_add(PRIME_2), PRIME_2, 0, 0u64.wrapping_sub(PRIME_1)];
        Checksum { lanes, rest: [0; STRIPE], total: 0 }
    }

    /// Appends bytes.
    pub fn add(&mut self, mut bytes: &[u8]) {
        let waiting = (self.total % STRIPE as u64) as usize;
        self.total += bytes.len() as u64;
        if waiting > 0 {
            let (now, later) = bytes.split_at(bytes.len().min(STRIPE - waiting));
            self.rest[waiting..waiting + now.len()].copy_from_slice(now);
            bytes = later;
            if waiting + now.len() < STRIPE {
                return;
            }
            let stripe = self.rest;
            self.stripe(&stripe);
        }
        let mut stripes = bytes.chunks_exact(STRIPE);
        for stripe in &mut stripes {
            self.stripe(stripe);
        }
        let rest = stripes.remainder();
        self.rest[..rest.len()].copy_from_slice(rest);
    }

    #[inline(always)]
    fn stripe(&mut self, stripe: &[u8]) {
        for (lane, word) in self.lanes.iter_mut().zip(stripe.chunks_exact(8)) {
            *lane = round(*lane, word_of(word));
        }
    }

    /// The checksum of all bytes so far.
    pub fn value(&self) -> u64 {
        let [a, b, c, d] = self.lanes;
        let mut hash = if self.total >= STRIPE as u64 {
            let sum = [a.rotate_left(1), b.rotate_left(7), c.rotate_left(12), d.rotate_left(18)];
            let sum = sum.into_iter().fold(0, u64::wrapping_add);
            self.lanes
                .iter()
                .fold(sum, |hash, &lane| (hash ^ round(0, lane)).wrapping_mul(PRIME_1).wrapping_add(PRIME_4))
        } else {
            PRIME_5
        };
        hash = hash.wrapping_add(self.total);
        let mut rest = &self.rest[..(self.total % STRIPE as u64) as usize];
        while let Some((word, later)) = rest.split_at_checked(8) {
            hash = (hash ^ round(0, word_of(word))).rotate_left(27).wrapping_mul(PRIME_1).wrapping_add(PRIME_4);
            rest = later;
        }
        if let Some((half, later)) = rest.split_at_checked(4) {
            let half = half.iter().rev().fold(0, |word, &byte| word << 8 | u64::from(byte));
            hash = (hash ^ half.wrapping_mul(PRIME_1)).rotate_left(23).wrapping_mul(PRIME_2).wrapping_add(PRIME_3);
            rest = later;
        }
        for &byte in rest {
            hash = (hash ^ u64::from(byte).wrapping_mul(PRIME_5)).rotate_left(11).wrapping_mul(PRIME_1);
        }
        hash = (hash ^ hash >> 33).wrapping_mul(PRIME_2);
        hash = (hash ^ hash >> 29).wrapping_mul(PRIME_3);
        hash ^ hash >> 32
    }
}

#[inline(always)]
fn round(lane: u64, word: u64) -> u64 {
    lane.wrapping_add(word.wrapping_mul(PRIME_2)).rotate_left(31).wrapping_mul(PRIME_1)
}

/// Eight bytes, the low one first.
#[inline(always)]
fn word_of(bytes: &[u8]) -> u64 {
    let mut word = [0; 8];
    word.copy_from_slice(bytes);
    u64::from_le_bytes(word)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Values of the reference implementation, made with the Python package `xxhash`.
    #[test]
    fn known_values() {
        let of = |bytes: &[u8]| {
            let mut sum = Checksum::new();
            sum.add(bytes);
            sum.value()
        };
        assert_eq!(of(b""), 0xef46_db37_51d8_e999);
        assert_eq!(of(b"a"), 0xd24e_c4f1_a98c_6e5b);
        assert_eq!(of(b"abc"), 0x44bc_2cf5_ad77_0999);
        assert_eq!(of(b"Nobody inspects the spammish repetition"), 0xfbce_a83c_8a37_8bf1);
    }

    #[test]
    fn pieces_of_any_length_make_the_same_checksum() {
        let bytes: Vec<u8> = (0..1000u32).map(|i| ((i * i) >> 3) as u8).collect();
        let mut whole = Checksum::new();
        whole.add(&bytes);
        for step in [1, 3, 7, 31, 32, 33, 64, 500] {
            let mut sum = Checksum::new();
            bytes.chunks(step).for_each(|piece| sum.add(piece));
            assert_eq!(sum.value(), whole.value(), "{step}");
        }
    }
}
