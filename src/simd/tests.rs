//! Every instruction set against the portable lanes, bit for bit.

use super::*;

/// The results of one round of all operations, as bits.
#[derive(PartialEq, Debug)]
struct Round {
    vectors: Vec<Lanes<u32>>,
    masks: Vec<Mask>,
    scalars: Vec<u32>,
    /// Compressed lanes, truncated to the count of the mask.
    packed: Vec<Vec<u32>>,
    /// Vectors of f64.
    doubles: Vec<[u64; 4]>,
}

struct All {
    a: Lanes<f32>,
    b: Lanes<f32>,
    mask: Mask,
}

impl Kernel for All {
    type Output = Round;
    #[inline(always)]
    fn run<S: Simd>(self, s: S) -> Round {
        let out_f = |x: S::F| {
            let mut to = [0.0; LANES];
            s.store(x, &mut to);
            // NaN payloads are not specified by IEEE 754.
            to.map(|v| if v.is_nan() { f32::NAN.to_bits() } else { v.to_bits() })
        };
        let out_u = |x: S::U| {
            let mut to = [0; LANES];
            s.store_u(x, &mut to);
            to
        };
        let (a, b) = (s.load(&self.a), s.load(&self.b));
        let (ua, ub) = (s.to_bits(a), s.to_bits(b));
        let [finite, finite_b] = [self.a, self.b].map(|of| of.map(|x| if x.is_nan() { 0.0 } else { x }));
        let n = self.mask.count_ones() as usize;
        let mut memory = StackMemory::<u64, 32>::new();
        let mut stack = memory.stack(32);
        stack.push_lanes(s, ub, Mask::MAX);
        let popped = [(); LANES].map(|()| stack.pop().expect("sixteen were pushed"));
        let long: Vec<f32> = self.a.into_iter().cycle().take(9 * LANES).collect();
        let thirds = s.load_thirds(&Rows::new(&long, 1 + self.mask as usize % 16, 9), self.mask as usize % 3);
        stack.push_lanes(s, ub, self.mask);
        let some_popped: Vec<u64> = core::iter::from_fn(|| stack.pop()).collect();
        let mut packed = ([0.0; LANES], [0; LANES]);
        s.store_compressed(a, self.mask, &mut packed.0);
        s.store_compressed_u(ub, self.mask, &mut packed.1);
        Round {
            vectors: vec![
                out_f(a + b),
                out_f(a - b),
                out_f(a * b),
                out_f(a / b),
                out_f(s.min(a, b)),
                out_f(s.max(a, b)),
                out_f(s.sqrt(a)),
                out_f(s.select(self.mask, a, b)),
                out_f(s.splat(self.a[3])),
                out_f(s.splat(s.lane(a, self.mask as usize % 16))),
                out_f(s.load_row(&Rows::new(&long, 1 + self.mask as usize % 16, 9), self.mask as usize % 9)),
                out_f(s.permute(a, ub)),
                out_f({
                    let third = |from: [f32; 4]| s.load_d(&from.map(|x| f64::from(x) / 3.0));
                    let [x, y, z, w] = [0, 4, 8, 12].map(|at| core::array::from_fn(|i| self.a[at + i]));
                    s.narrow_all([third(x), third(y), third(z), third(w)])
                }),
                out_f({
                    let rows = [self.a, self.b, self.a].map(|row| row.map(|x| f64::from(x) / 3.0));
                    s.squared_distances(rows.each_ref(), [self.b[1], self.a[2], self.b[3]].map(|x| f64::from(x) / 7.0))
                }),
                out_f({
                    let (mut to, count) = ([7.0; LANES], self.mask.count_ones() as usize);
                    s.store_compressed_d(&self.b.map(|x| f64::from(x) / 3.0), self.mask, &mut to);
                    to[count..].fill(0.0);
                    let four = |i: usize| s.load_d(&to.as_chunks().0[i]);
                    s.narrow_all([four(0), four(1), four(2), four(3)])
                }),
                out_f(thirds[0]),
                out_f(thirds[1]),
                out_f(thirds[2]),
                out_u(s.swap_lanes_u::<1>(ua)),
                out_u(s.swap_lanes_u::<2>(ua)),
                out_u(s.swap_lanes_u::<3>(ua)),
                out_u(s.swap_lanes_u::<4>(ub)),
                out_u(s.swap_lanes_u::<8>(ub)),
                out_u(s.swap_lanes_u::<15>(ua)),
                out_f(s.swap_lanes::<8>(a)),
                out_f(s.swap_lanes::<3>(b)),
                out_f(s.from_bits(ua)),
                popped.map(|lane| u32::try_from(lane).expect("zeros above")),
                out_u(s.shift_right::<4>(ua)),
                out_u(s.sort_u(ua)),
                out_u(s.add_u(ua, ub)),
                out_u(s.min_u(ua, ub)),
                out_u(s.max_u(ua, ub)),
                out_u(s.to_bits(s.max_signed(a, b))),
                out_u(s.to_bits(s.min_signed(a, b))),
                out_f(s.max_with_zero(s.load(&finite), s.load(&finite_b))),
                out_u(ua & ub),
                out_u(ua | ub),
                out_u(s.select_u(self.mask, ua, ub)),
                out_u(s.load_u(&self.a.map(f32::to_bits))),
                out_u(s.splat_u(self.b[5].to_bits())),
            ],
            masks: vec![
                s.lt(a, b),
                s.le(a, b),
                s.le_signed(a, b),
                s.eq(a, b),
                s.eq(a, a),
                s.eq_u(ua, ub),
                s.lt_u(ua, ub),
                s.le_d(s.widen_four(&[self.a[0], self.a[1], self.a[2], self.a[3]]), s.widen_four(&[self.b[0]; 4])),
            ],
            scalars: vec![s.reduce_min_u(ua)],
            packed: vec![
                out_f(s.load(&packed.0))[..n].to_vec(),
                packed.1[..n].to_vec(),
                some_popped.into_iter().map(|x| u32::try_from(x).expect("32 bits")).collect(),
            ],
            doubles: {
                let out = |x: S::D| s.lanes_d(x).map(|v| if v.is_nan() { f64::NAN.to_bits() } else { v.to_bits() });
                let four = |from: &Lanes<f32>| [from[0], from[1], from[2], from[3]].map(|x| f64::from(x) / 3.0);
                let (a, b) = (s.load_d(&four(&self.a)), s.load_d(&four(&self.b)));
                let widened = s.widen([self.a[4], self.a[5], self.a[6]]);
                let picked = s.pick_four(s.load(&self.a), self.b[6].to_bits());
                let more = [s.splat_d(f64::from(self.b[7]) / 3.0), s.rotate_left(a), s.rotate_right(a)];
                let first = [self.a[0], self.a[1], self.a[2], self.a[3]];
                let narrowed = s.widen_four(&s.narrow(a));
                let chosen = [s.min_d(a, b), s.max_d(a, b), s.select_le(a, b, widened, more[1]), narrowed];
                let computed = [a + b, a - b, a * b, a / b, s.sqrt_d(a), s.widen_four(&first), widened, picked];
                let turned = s.transpose_d([a, b, widened, narrowed]);
                computed.into_iter().chain(more).chain(chosen).chain(turned).map(out).collect()
            },
        }
    }
}

fn next(state: &mut u64) -> u64 {
    *state ^= *state << 13;
    *state ^= *state >> 7;
    *state ^= *state << 17;
    *state
}

#[test]
fn every_level_agrees_with_the_portable_lanes_bit_for_bit() {
    let special = [0.0, -0.0, 1.0, -1.0, f32::INFINITY, f32::NEG_INFINITY, f32::NAN, 1e-40, f32::MAX, 0.1];
    let mut state = 0x9e37_79b9_7f4a_7c15;
    for round in 0..20_000 {
        let mut lanes = || {
            core::array::from_fn(|_| {
                let r = next(&mut state);
                match (round % 4, r % 8) {
                    (0, _) => f32::from_bits((r >> 16) as u32),
                    (_, 0..3) => special[(r >> 8) as usize % special.len()],
                    _ => ((r >> 16) as i32 % 1000) as f32 * 0.125,
                }
            })
        };
        let (a, b) = (lanes(), lanes());
        let mask = next(&mut state) as Mask;
        let expected = All { a, b, mask }.run(Portable);
        for level in SimdLevel::available() {
            let got = dispatch(level, All { a, b, mask });
            assert_eq!(got, expected, "{level}, a {a:?}, b {b:?}, mask {mask:016b}");
        }
    }
}

#[test]
fn operations_that_may_fuse_are_within_one_rounding_of_the_plain_form() {
    struct Fused(Lanes<f32>, Lanes<f32>, Lanes<f32>);
    impl Kernel for Fused {
        type Output = [Lanes<f32>; 2];
        #[inline(always)]
        fn run<S: Simd>(self, s: S) -> [Lanes<f32>; 2] {
            let (a, b, c) = (s.load(&self.0), s.load(&self.1), s.load(&self.2));
            let mut to = [[0.0; LANES]; 2];
            s.store(s.mul_add(a, b, c), &mut to[0]);
            s.store(s.negated_mul_add(a, b, c), &mut to[1]);
            to
        }
    }
    let mut state = 7;
    for _ in 0..1000 {
        let mut lanes = || core::array::from_fn(|_| (next(&mut state) >> 40) as f32 / 1024.0 - 8192.0);
        let (a, b, c): (Lanes<f32>, Lanes<f32>, Lanes<f32>) = (lanes(), lanes(), lanes());
        for level in SimdLevel::available() {
            let [sum, difference] = dispatch(level, Fused(a, b, c));
            for i in 0..LANES {
                let (product, c) = (f64::from(a[i]) * f64::from(b[i]), f64::from(c[i]));
                let least = (product.abs() + c.abs()) * f64::from(f32::EPSILON);
                assert!((f64::from(sum[i]) - (c + product)).abs() <= least, "{level}");
                assert!((f64::from(difference[i]) - (c - product)).abs() <= least, "{level}");
            }
        }
    }
}

#[test]
fn the_arena_begins_on_cache_lines_and_keeps_what_is_written() {
    let mut arena = Arena::default();
    let a = arena.grow(5);
    arena.ints_mut()[a + 4] = 1.5f32.to_bits();
    arena.align();
    let b = arena.grow(3);
    arena.ints_mut()[b] = 7;
    assert_eq!((a, b), (0, 16));
    arena.compact();
    assert_eq!(arena.floats().as_ptr() as usize % 64, 0);
    assert_eq!(arena.floats()[4].to_bits(), arena.ints()[4]);
    assert_eq!((arena.floats()[4], arena.ints()[16]), (1.5, 7));
    assert_eq!(arena.block(16)[..16], arena.floats()[16..32], "lines may be read beyond the last block");
    assert!(arena.bytes() >= 128);
}

#[test]
fn single_lanes_of_rows_are_those_of_the_rows_and_no_others_are_read() {
    let words: Vec<f32> = (0..9 * 5).map(|i| i as f32).collect();
    let rows = Rows::new(&words, 5, 9);
    assert_eq!(rows.lane_of_thirds(2, 4), [14.0, 29.0, 44.0]);
    let refused = |read: fn(&Rows)| {
        let rows = Rows::new(&words, 5, 9);
        std::panic::catch_unwind(core::panic::AssertUnwindSafe(|| read(&rows))).is_err()
    };
    let reads: [fn(&Rows); 2] = [|rows| _ = rows.lane_of_thirds(3, 0), |rows| _ = rows.lane_of_thirds(0, 5)];
    for (i, read) in reads.into_iter().enumerate() {
        assert!(refused(read), "read {i}");
    }
}
