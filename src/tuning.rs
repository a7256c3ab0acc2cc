//! All constants that were fitted rather than derived, with the command that shows the effect of another value: change it,
//! run the command before and after, and compare the rows. Some beside them are chosen, and say so.
//!
//! None of them changes an answer. Sizes of caches are round numbers between typical ones: `NEAR` fits a second level,
//! `FAR` exceeds one core's share of a third. A size that is off by a factor of two costs superfluous prefetches,
//! or omits a few useful ones.

/// The wide tree, and ray queries in one that is larger than the caches.
///
/// `cargo bench --bench ray_choices`
pub(crate) mod wide {
    use core::ops::RangeInclusive;

    /// The relative costs of the steps of a query: a node, a leaf block, each primitive in it, and the factor on all of these for
    /// static nodes and leaves. A primitive at .15 instead of about .07 makes smaller leaves, which costs 4 to 10 % of the speed on
    /// the scenes coherent, debris and tornado.
    pub const NODE_COST: f32 = 2.0;
    pub const LEAF_COST: f32 = 1.0;
    pub const PRIMITIVE_COST: f32 = 0.07;
    pub const STATIC_FACTOR: f32 = 0.7;
    /// The leaf size of the binary tree: the lower limit, and the upper limit for overlapping references; the collapse merges
    /// leaves again.
    pub const BINARY_LEAF: RangeInclusive<usize> = 8..=16;
    /// An approximate upper limit of the bytes of a reference in nodes and leaf blocks together.
    pub const BYTES_PER_REFERENCE: f32 = 110.0;
    /// If both sides of a split together have this many times the area of the node, further splits are unlikely to be much
    /// better: needles and hair. A single leaf block of sixteen costs a query no more there.
    pub const MIN_OVERLAP: f32 = 1.4;
    /// Nodes of few references are split further if they are visited by more than this fraction of the rays that enter the tree, or
    /// of the visits to all primitives if those are fewer, and more often than as many primitives are by themselves. There are few
    /// such nodes: at most the leaves that a ray visits, divided by this fraction. Doing this with every leaf would take longer
    /// than a level of the build. Half the value finds little more in rooms of a tenth to four times the triangles, twice the value
    /// misses some of the floors in them:
    /// `cargo bench --bench embree -- --only ours --scenes building,visited,needles --side 64 --runs 1 --scale 0.1` counts.
    pub const LARGE_LEAF: f32 = 1.0 / 256.0;
    /// If a ray meets more boxes of primitives than this, leaves count as large by the visits to all primitives, divided by this
    /// number: otherwise most leaves of needles would, and be split into single references, which takes a third of their build and
    /// saves rays 2 % of the work. Needles and hair have 9 to 50 of them, fur 11, all else up to 4:
    /// `cargo bench --bench embree -- --only ours --scenes needles,needles30,hairball --side 64 --runs 1` counts.
    pub const MANY_BOXES: f32 = 4.0;
    /// Bytes of primitives up to which their vertices are in a near cache when leaf blocks are written. (Not fitted: half of a
    /// second-level cache.)
    pub const NEAR: usize = 512 << 10;
    /// Trees up to this many bytes mostly stay in the caches, so that neither the order of rays nor interleaving gains much.
    pub const CACHED: usize = 64 << 20;
    /// Words of a tree from which on the blocks that a query will visit are prefetched: then they are often not in the
    /// cache, and if they are, a prefetch only costs.
    pub const AHEAD: usize = 8 << 20;
    /// Words of a tree from which on the rows of blocks with many keys are prefetched: `cargo bench --bench keys`.
    pub const KEYED_AHEAD: usize = 1 << 18;
}

/// Lazy trees.
///
/// `cargo bench --bench lazy`
pub(crate) mod lazy {
    /// The largest number of primitives of a subtree. For pictures that test 5 % of the triangles, with 1024 the coarse build
    /// takes a fifth longer and about as much is built; with 4096 a fifth more is built and the coarse build takes hardly
    /// less (hall and coherent, `--subtree`).
    pub const SUBTREE: usize = 2048;
    /// The greatest number of cells along an axis of the grid that the coarse build puts primitives into, and the number of
    /// primitives that its box is found from. With 24 cells the build and what rays build take .90 to .97 of the time in hall,
    /// debris and coherent, but 1.12 and 1.05 of it in camera and crowd.
    pub const CELLS: usize = 16;
    pub const PLACED: usize = 4096;
    /// A cell with more than this many times the primitives of a subtree gets a grid of its own. With 1 the lazy build and what
    /// rays build take .97 to 1.12 of the time, and rays 1.00 to 1.05 of theirs (docs/notes_rays_tried.md).
    pub const CROWDED: usize = 4;
    /// What a subtree costs beside its primitives, in primitives; it decides where the coarse tree ends. Building one takes longer
    /// than its share of a whole build, and a ray that enters it needs some time. With 128 less is built in debris and hand, but
    /// rays take a tenth longer in tornado and hand. With 512 debris, building and coherent need a tenth more, other scenes the
    /// same.
    pub const SUBTREE_COST: f32 = 256.0;
    /// Pre-splits and temporal splits are decided on once for neighbouring subtrees with together at most so many times the
    /// primitives of a full one, by so many neighbours at each of some places. With half of the first two numbers the hand needs a
    /// tenth more, and parts of the hairball are divided, which takes a tenth longer to build and gains rays nothing.
    pub const GROUP: usize = 32;
    pub const NEIGHBOURS: usize = 256;
    pub const PLACES: usize = 4;
}

/// Early split clipping of triangles before the build.
///
/// `cargo bench --bench ray_choices -- --only cuts`
pub(crate) mod presplit {
    use core::ops::RangeInclusive;

    /// Pre-splitting is done if the expected cost of a ray falls below this fraction of the previous cost: it takes memory.
    pub const MAX_PRESPLIT_COST: f32 = 0.95;
    /// If a sample gives a cost fraction in this range, the next sample is tried as well.
    pub const UNCERTAIN_PRESPLIT_COST: RangeInclusive<f32> = 0.9..=1.0;
    /// Pre-splitting is tried if the boxes have at least this many times the area of the triangles in them.
    pub const MIN_AREA_RATIO: f64 = 8.0;
    /// Pre-splitting is decided on neighbourhoods of a sixteenth of all references together, each in these bounds.
    pub const PRESPLIT_SAMPLES: usize = 2;
    pub const PRESPLIT_SAMPLE: RangeInclusive<usize> = 512..=4096;
    /// A split must save at least this times the area of an average reference: it costs memory and a test.
    pub const MIN_SAVING: f32 = 0.2;
    /// The area that is left when nothing can be gained, in areas of the triangle: about that of a triangle in
    /// random position.
    pub const LEAST_AREA: f32 = 4.0;
}

/// Reinsertion of subtrees.
///
/// `cargo bench --bench embree -- --only ours --side 64 --runs 1` counts.
pub(crate) mod reinsertion {
    /// The share of the subtrees that are tried in the first round, and the least number of them; the next round tries twice as
    /// many. Twice the share costs twice as much where it pays (21 instead of 10 % of the build in building), and gains a seventh
    /// more.
    pub const SHARE: f32 = 0.01;
    pub const LEAST_NODES: usize = 16;
    /// The greatest number of rounds.
    pub const ROUNDS: usize = 4;
    /// A round must gain this fraction of the visits of the nodes that it tries for another one to follow. Most trees over evenly
    /// sized triangles do not gain it in the first round.
    pub const LEAST_GAIN: f32 = 0.02;
    /// The greatest number of places that are compared for a subtree. With 32 visited and hall lose a tenth, with 256 nothing is
    /// gained.
    pub const MOST_STEPS: usize = 64;
}

/// Temporal splits of the wide tree.
///
/// `cargo bench --bench ray_choices`
pub(crate) mod slices {
    use core::ops::RangeInclusive;

    /// The approximate number of treelets of a draft, and the smallest number of references of one.
    pub const TREELETS: usize = 256;
    pub const LEAST_TREELET: usize = 1024;
    /// Number of sampled references of a treelet.
    pub const TREELET_SAMPLE: u32 = 64;
    /// If halves of the shutter gain nothing, so many of its sixteenths are tried on bent motion.
    pub const SHORT_SLICES: usize = 4;
    /// Splitting a treelet pays if boxes for each half of the shutter have less than this fraction of the area.
    pub const MAX_AREA_OF_HALVES: f32 = 0.87;
    /// A region must gain this fraction of the cost of the whole tree.
    pub const MIN_GAIN: f32 = 0.002;
    /// This fraction of all rays is assumed to be aimed at primitives, at each as often. (Not fitted. Without it a rotor over a
    /// floor that is three hundred times as wide is not divided, and rays at it test sixty times as many triangles.)
    pub const AIMED: f32 = 1.0 / 16.0;
    /// The whole tree is divided if it has at most this many times the references of a region: the rest is then in each of its
    /// trees, so it has at most this many times the bytes, and rays have one node less to pass. With 1.01 flags on poles, robots at
    /// a conveyor and gears take 1.07 to 1.27 times the work and .97 to .99 of the bytes, 31 other scenes the same ("Deciding on
    /// time slices" in docs/notes_rays.md).
    pub const NEARLY_ALL: f32 = 1.1;
    /// Halves of a region of which one gains less than this fraction of what the other one gains are separate regions. A greatest
    /// difference of the areas instead, .15, made the same of halves that gain a quarter to a half, but divided moons in orbit
    /// where all gain most: 1.4 times the time ("Deciding on time slices" in docs/notes_rays.md).
    pub const MIN_SIMILARITY: f32 = 0.625;
    /// Subregions of a rejected region are compared up to this many levels below it, if they have at least this many
    /// treelets.
    pub const LEVELS: usize = 3;
    pub const FEW: usize = 16;
    /// The latency of a ray is mostly that of nodes. So hierarchies with shared leaf blocks count as this fraction of
    /// separate trees in this respect: two cost 7 to 30 % more than their counted steps and tests, four 20 to 60 %
    /// (coherent, debris, tornado, hairball).
    pub const NODE_LATENCY_SHARE: f32 = 0.8;
    /// What a key of a primitive counts beside that: leaf blocks with two keys are the rest ("What growing costs, by keys" in
    /// docs/notes_rays.md).
    pub const KEY_LATENCY_SHARE: f32 = 0.1;
    /// A temporal split is used if it costs less than this fraction of the unsplit tree: it takes memory and time to build.
    pub const MAX_SPLIT_COST: f32 = 0.87;
    /// If nothing has paid, two slices with shared leaves must cost less than this for separate trees to be tried.
    pub const MAX_TWO_SLICES_COST: f32 = 0.85;
    /// Separate trees, and more of them, must take less than this fraction of the time.
    pub const MAX_FURTHER_TIME: f32 = 0.95;
    /// Separate trees must take less than this fraction of the time of shared leaves if motion has more than two keys, or
    /// primitives come and go: they take several times as long to build, and hold keys again (`cargo bench --bench keys`). With .9
    /// fifty scenes take 1.004 of the time and 1.09 of the bytes ("What growing costs, by keys").
    pub const MAX_SEPARATE_TIME: f32 = 0.8;
    /// Nodes are a quarter to nearly a half of a tree's bytes; leaf blocks are the rest, which time slices share.
    pub const NODE_BYTES_SHARE: f32 = 0.45;
    /// A temporal split is decided on at most this many subtrees of at least so many references.
    pub const SAMPLES: usize = 4;
    pub const LEAST_SAMPLE: usize = 128;
    /// Together they have one in so many of the references of a region: one in eight, if these are not more than enough. Smaller
    /// ones would predict too little for separate trees, since primitives that are together at mid-shutter separate.
    pub const SAMPLED: RangeInclusive<usize> = 8..=16;
    pub const ENOUGH: usize = 6144;
}

/// Trees over points: the choice of a structure, and the sizes from which on memory latency matters.
///
/// `cargo bench --bench point_choices` prints means over all kinds of sets; costs are the least squares of
/// `cargo bench --bench neighbor_tables -- costs`. What is said of other values is how these means change: of builds, and of the
/// counted work of searches. Means of builds repeat within a few percent. "Fits of the choice" in docs/notes_neighbors.md has what
/// was measured.
pub(crate) mod points {
    use core::ops::RangeInclusive;

    /// Number of samples; the smallest and the largest number of points of each; points of the set per sampled point.
    /// `--kinds motion --points 30000,100000`: with bounds half or twice as large builds 1.01 and 1.04, work .998; with 32 and 128
    /// points per sampled one builds 1.1 and 1.2, work .999, since more trees are built in vain. (The number of samples is not
    /// fitted.)
    pub const SAMPLES: usize = 4;
    pub const SAMPLE: [usize; 2] = [256, 2048];
    pub const SAMPLED: usize = 64;
    /// The smallest and the largest number of searches in all samples; points of the set per search. Half as many: builds .97, work
    /// 1.00, but single sets 1.12; twice as many: builds 1.06, work 1.00.
    pub const SEARCHES: [usize; 2] = [96, 384];
    pub const SEARCHED: usize = 256;
    /// Cost of a block in nodes: a node has twelve rows and children to be processed, a block has six rows.
    pub const BLOCK_COST: f64 = 0.4;
    /// The additional cost of a search if all its data come from memory, in nodes. The data are adjacent and prefetched, so this
    /// does not grow with the work. (26 by least squares on one machine, 54 to 73 on another whose caches are shared; between
    /// these, k = 8 and radius searches together take least. "The cost of memory" in docs/notes_neighbors.md.)
    pub const UNCACHED_COST: f64 = 40.0;
    /// Bytes of a structure half of which misses the caches: the more trees searches are spread over, the less one finds of the
    /// data that the one before has fetched. The fit is nearly as good anywhere from half to five times that, with other costs.
    pub const HALF_UNCACHED_BYTES: f64 = 100e6;
    /// Bytes of a reference with its share of nodes. (Not fitted: a block of sixteen is 448 bytes long, its share of nodes another
    /// 64.)
    pub const REFERENCE_BYTES: f64 = 32.0;
    /// A structure must cost less than this fraction of a smaller one to be chosen. (Not fitted: the choice should cost at most
    /// 1.07 times the best.) With .9 builds take .91 of the time, work is 1.006.
    pub const MAX_COST: f64 = 0.93;
    /// The cost of a structure in samples, relative to another one in the whole set, below which a tree of it is built and
    /// measured. Samples underestimate costs by a few percent. `--kinds motion --points 30000,100000`: with .8 builds .97 and work
    /// 1.001, but a single set 1.06; with .93 builds 1.1 and work .998.
    pub const MAX_PREDICTED_COST: f64 = 0.87;
    /// Time slices half as long must cost at most this fraction for still shorter ones to be tried, and so for those of a few fast
    /// points to be chosen, which take little memory. `--kinds motion --points 30000,100000`: with .95 and 1 the same means; a
    /// single set costs 1.04 and 1.10.
    pub const MAX_REFINED_COST: f64 = 0.98;
    /// What a search for eight neighbours visits in a tree of points at rest at most, in nodes; where searches visit
    /// more, fewer of them are counted. With 8 and 16 the choices are the same.
    pub const MOST_AT_REST: f64 = 12.0;
    /// For so many points, structures are compared by trees of all points instead of samples. Samples of more take less time than
    /// trees, and only sets of more gain by a tree of their own for fast points. `--kinds motion --points 10000,30000`: up to 4096
    /// only, builds 1.3 at 10 000 points, work 1.002; up to 60 000, builds 1.1 at 30 000, work .996, but 22 instead of 6 and 10
    /// static builds where a few are fast. Where there are fewer, nothing else than one tree gains:
    /// `--kinds motion --points 50,64,100,130`.
    pub const OWN_TREES: RangeInclusive<usize> = 65..=24 << 10;
    /// Larger sets with active intervals are compared by trees of all points as well, if they can afford about this many time
    /// slices: then the tree of a time slice is built sooner than samples. In longer ones, fast points need trees of their own.
    /// `--kinds active --points 30000,100000`: with 4 active intervals of .9 with 1 % fast points take 28 instead of 8 static
    /// builds; with 16 births are tried by samples, builds 1.05.
    pub const SHORT_SLICES: f64 = 8.0;
    /// What is visited in the tree of a time slice grows with this power of the number of its points and of the volume of its
    /// boxes. (Least squares over trees of 30 kinds of sets, 1000 to 300 000 points, gave .55 to .8 and .61 to .7 for nodes and
    /// blocks; with .55 the median of expected costs is right. "Builds of sets with active intervals" in docs/notes_neighbors.md.)
    /// `--kinds active`: with .45 builds .98, work 1.002, single sets 1.08; with .65 builds 1.01, work 1.000, single sets 1.05.
    pub const VISITED: f64 = 0.55;
    /// Points with active intervals are searched at two times in the shortest time slices that are tried. Of longer ones the trees
    /// of both are built if the lower cost is expected to be less than this fraction of the higher one. `--kinds active`: with 1
    /// builds 1.03 to 1.05, work 1.001.
    pub const MOST_ALIKE: f64 = 0.8;
    /// Of time slices that are predicted to cost nearly the same, the longest are tried: those that the best cost this fraction of;
    /// and once some have gained, shorter ones only if they are predicted to cost less than this fraction.
    /// `--kinds motion --points 1000,3000,10000`: with .9 builds .9, work 1.025, single sets 1.3; with .99 builds 1.06, work .998.
    pub const NEARLY: f64 = 0.95;
    /// If the first tree of time slices costs more than so many times what was predicted, longer ones may be as good.
    /// `--kinds motion --points 1000,3000,10000`: with 1 work 1.005, with 1.35 1.001; without it points that meet in the middle
    /// take 17 to 20 instead of 12 static builds, work 1.04 to 1.16.
    pub const OVERESTIMATED: f64 = 2.0;
    /// A point is fast if it moves farther, relative to its neighbours, than this many times the size of a leaf: the one that they
    /// share in the middle of the slice, or the median of all leaves if that is smaller. (A point that has left the others by then
    /// shares a large leaf with few points.) `--kinds motion --points 30000,100000`: with 1 work .997, but at random motion more
    /// points are fast, builds 1.04; with 4 builds 1.1, work 1.004, sets with fast points 1.17.
    pub const FAST: f32 = 2.0;
    /// Points are divided by motion instead of position if that costs less than this fraction: it leaves points on the wrong side,
    /// and nodes overlap more. `--kinds motion --points 10000,100000`: with .75 work 1.002, streams 1.07 and 1.14; with .93 builds
    /// 1.04, work .997.
    pub const MAX_MOTION_COST: f64 = 0.85;
    /// They are not divided along an axis if displacements spread less than this there, in leaves. It saves time only: with .25 and
    /// 1 the work is the same.
    pub const MIN_MOTION_SPREAD: f64 = 0.5;
    /// A set is divided into static and moving points if at least this fraction is static. With .25 sets half of which streams cost
    /// 1.4 times as much, with .75 they cost less if they are small, but 40 % fast points among static ones take 20 instead of 10
    /// static builds.
    pub const MIN_STATIC_SHARE: f64 = 0.5;
    /// They are divided in any case if at least this fraction is static. Searches for eight take .80 to 1.04 of the time of one
    /// tree if 1 % of the points or fewer move by a spacing, .96 to 1.16 if 5 % do, and 1.06 to 1.26 if 20 % do, at .54 to .76 of
    /// the bytes ("Fits of the choice" in docs/notes_neighbors.md).
    pub const MOSTLY_STATIC: f64 = 0.9;
    /// Others are divided if boxes of all points together are more than so many times as large as those of points at rest.
    /// `--only "rest static"`: with 1.1 20 and 40 % of points that move by a spacing cost 1.2 to 1.7 times the best; with 1.25
    /// streams cost 1.55; without this, all of them do.
    pub const MAX_TOGETHER: f64 = 1.5;
    /// Once a search for k neighbours has a threshold, the leaves of a bottom node are visited at once unless they are this many
    /// more than those that give a new threshold. With 4, queries near uniform points take 1.02 to 1.07 times as long, and far ones
    /// gain no more: `cargo bench --bench neighbor_tables -- static --points 10000,100000`.
    pub const SEVERAL: usize = 6;
    /// Bytes of leaves above which most of them miss all caches.
    pub const FAR: usize = 32 << 20;
    /// Bytes of leaves up to which most of them hit a near cache.
    pub const NEAR: usize = 2 << 20;
}

/// Trees over points that are built again for each step of a simulation.
///
/// `cargo bench --bench lists -- --only growth`
pub(crate) mod steps {
    /// Growth of the boxes of leaves, relative to those above them, added up over the steps, up to which the order is kept.
    ///
    /// Keeping it costs a little in each step: a search visits the more leaves the larger they are. Putting all points in
    /// order costs once. Doing so when the former have added up to the latter costs at most twice what the best moment
    /// would have cost, however points move (the rule of renting or buying skis). Sides larger by a share g make neighbour
    /// lists slower by about 1.2 g, and ordering all points costs about a third of the lists' time more than keeping the
    /// order: so the sum of g is 0.3. The command measures both.
    pub const MOST_EXCESS: f64 = 0.3;
}
