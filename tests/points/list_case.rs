//! Requests for lists at a time, answered by comparing all pairs, in either precision.

use crate::set::Set;
use mbkd::{ListQuery, NeighborLists, PointTree, Radii, glam::DVec3};

/// A request.
#[derive(Clone, Debug)]
pub struct ListCase<'a> {
    pub time: f32,
    pub radii: Radii<'a>,
    pub periods: [Option<f64>; 3],
    pub once: bool,
    /// Among the points of another set.
    pub other: bool,
}

/// A neighbour: id, and the bits of the squared distance and of the displacement.
pub type Entry = (u32, u32, [u32; 3]);

impl<'a> ListCase<'a> {
    pub fn plain(time: f32, radius: f32) -> ListCase<'a> {
        ListCase { time, radii: Radii::Equal(radius), periods: [None; 3], once: false, other: false }
    }

    pub fn query<'b>(&self, tree: &'b PointTree, among: &'b PointTree) -> ListQuery<'b>
    where
        'a: 'b,
    {
        let mut query = tree.neighbor_lists(self.time, self.radii).periodic(self.periods);
        if self.once {
            query = query.pairs_once();
        }
        if self.other {
            query = query.among(among);
        }
        query
    }

    /// The square of the radius of a pair.
    fn bound(&self, i: usize, j: usize) -> f32 {
        let radius = match self.radii {
            Radii::Equal(radius) => radius,
            Radii::Own(own) => own[i],
            Radii::Larger { own, others } => own[i].max(others[j]),
            Radii::Sum { own, others } => own[i] + others[j],
        };
        (radius * radius).min(f32::MAX)
    }

    /// All lists of a set, among itself or the other one, by comparing all pairs.
    pub fn expected(&self, [own, other]: [&Set; 2]) -> Vec<Vec<Entry>> {
        let among = if self.other { other } else { own };
        let mut lists = vec![Vec::new(); own.len()];
        let places: Vec<DVec3> = (0..among.len()).map(|j| among.at(j, self.time)).collect();
        for (i, list) in lists.iter_mut().enumerate().filter(|(i, _)| own.active[*i].contains(self.time)) {
            let place = own.at(i, self.time);
            for j in (0..among.len()).filter(|&j| among.active[j].contains(self.time)) {
                let wanted = if self.once { j > i } else { self.other || j != i };
                let (displacement, squared) = own.apart([place, places[j]], self.periods);
                if wanted && squared <= self.bound(i, j) {
                    list.push((j as u32, squared.to_bits(), displacement.map(|x| (x + 0.0).to_bits())));
                }
            }
        }
        lists
    }

    /// Whether the lists of a tree of this set are those, in the order of ids and in that of the tree.
    pub fn check(
        &self,
        expected: &[Vec<Entry>],
        [tree, among]: [&PointTree; 2],
        set: &Set,
        lists: &mut NeighborLists,
        what: &str,
    ) {
        let query = self.query(tree, among);
        query.in_order().sorted().with_distances().with_displacements().run(lists).unwrap();
        assert_eq!(lists.len(), set.len(), "{what}");
        for (i, (found, expected)) in found(lists).iter().zip(expected).enumerate() {
            assert_eq!(found, expected, "{what}: point {i}, {self:?}");
        }
        // In the order of the tree and unsorted: the same lists.
        query.run(lists).unwrap();
        assert!(lists.distances_squared().is_empty());
        let active = (0..set.len()).filter(|&i| set.active[i].contains(self.time)).count();
        assert_eq!(lists.len(), active, "{what}");
        for (id, row) in lists.iter() {
            let mut row = row.to_vec();
            row.sort_unstable();
            assert!(row.iter().copied().eq(expected[id as usize].iter().map(|n| n.0)), "{what}: point {id}, {self:?}");
        }
    }
}

/// The entries of all lists, which have distances and displacements.
fn found(lists: &NeighborLists) -> Vec<Vec<Entry>> {
    let [x, y, z] = lists.displacements();
    let bits = |n: usize| [x[n], y[n], z[n]].map(|x| (x + 0.0).to_bits());
    let entry = |n: usize| (lists.ids()[n], lists.distances_squared()[n].to_bits(), bits(n));
    lists.offsets().windows(2).map(|ends| (ends[0]..ends[1]).map(entry).collect()).collect()
}
