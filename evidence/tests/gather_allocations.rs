//! Gathers allocate nothing once their scratch has grown: counted at the allocator, in a program of its own.

use mbkd::glam::Vec3;
use mbkd::point::{GatherParams, GatherQuery, Kernel, NeighborBuffer, Photon, PhotonMap, VisiblePoint, VisiblePoints};
use peak_alloc::PeakAlloc;

#[global_allocator]
static ALLOCATED: PeakAlloc = PeakAlloc;

#[test]
fn gathers_allocate_nothing_once_their_scratch_has_grown() {
    let place = |i: usize| Vec3::new((i % 173) as f32 / 173.0, 0.0, (i % 211) as f32 / 211.0);
    let time = |i: usize| (i % 97) as f32 / 97.0;
    let photons: Vec<_> = (0..20_000).map(|i| Photon::at_time(place(i), Vec3::Y, 1.0f32, time(i))).collect();
    let map = PhotonMap::build(&photons, &GatherParams::default()).unwrap();
    let seen: Vec<_> = (0..5000).map(|i| VisiblePoint { position: place(i), time: time(i), radius: 0.05 }).collect();
    let points = VisiblePoints::build(&seen, &GatherParams::default()).unwrap();
    let mut scratch = NeighborBuffer::new();
    let mut run = || {
        let mut count = 0;
        for i in 0..2000 {
            let query = GatherQuery::new(place(7 * i), Vec3::Y, time(3 * i)).radius(0.1).window(0.1).cosine(0.5);
            let query = query.kernels(Kernel::Gaussian, Kernel::Cone);
            count += map.gather(&query, &mut scratch).unwrap().count;
            count += map.gather(&query.nearest(50), &mut scratch).unwrap().count;
            count += map.nearest_in_space_time(place(5 * i), time(i), 0.3, 30, &mut scratch).unwrap().len();
            points.for_each(place(i), time(i), 0.1, &mut scratch, |_, _| count += 1).unwrap();
        }
        count
    };
    let first = run();
    ALLOCATED.reset_peak_usage();
    let (before, again) = (ALLOCATED.current_usage(), run());
    assert_eq!((ALLOCATED.peak_usage(), ALLOCATED.current_usage()), (before, before));
    assert!(first == again && first > 100_000, "{first} {again}");
}
