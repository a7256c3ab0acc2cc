//! Every constant that was fitted rather than derived, with the command that shows what another value does: change it, run
//! the command before and after, and compare the rows.
//!
//! None of them changes an answer. Sizes of caches are round numbers between usual ones: what is near fits a second level,
//! what is far exceeds one core's share of a third. A size that is off by a factor of two costs prefetches that are not
//! needed, or a few that are missing.

/// The wide tree, and what rays do in one that is larger than caches.
///
/// `cargo bench --bench ray_choices`
pub(crate) mod wide {
    use core::ops::RangeInclusive;

    /// What the steps of a query cost, relative to each other: a node, a leaf block, each primitive in it, and what all of
    /// that is multiplied by where nothing moves. A primitive at .15 instead of about .07 makes smaller leaves, which costs 4 to 10 % of
    /// the speed on the scenes coherent, debris and tornado.
    pub const NODE_COST: f32 = 2.0;
    pub const LEAF_COST: f32 = 1.0;
    pub const PRIMITIVE_COST: f32 = 0.07;
    pub const STILL_COST: f32 = 0.7;
    /// References at which the binary tree stops, or where they are crowded; the collapse joins its leaves again.
    pub const BINARY_LEAF: RangeInclusive<usize> = 8..=16;
    /// Bytes that a reference costs in nodes and leaf blocks together, at most about.
    pub const BYTES_PER_REFERENCE: f32 = 110.0;
    /// Where both sides of a split have this many times the area of the node, neither is likely to be split much better:
    /// parts of needles and hair. A leaf block of sixteen at once costs a query no more there.
    pub const CROWDED: f32 = 1.4;
    /// Nodes of few references are split on where they are visited by more than this share of the rays that come to the tree, or of the
    /// visits to all primitives where those are fewer. There are few such nodes: at most the leaves that a ray visits, divided by this
    /// share. To do it with every leaf would take longer than a level of the build. Half of it finds little more in rooms of a tenth to
    /// four times the triangles, twice as much misses some of the floors in them:
    /// `cargo bench --bench embree -- --only ours --scenes building,visited,needles --side 64 --runs 1 --scale 0.1` counts.
    pub const LARGE_LEAF: f32 = 1.0 / 256.0;
    /// Trees up to this many bytes mostly stay in the caches, where neither the order of rays nor taking turns gains much.
    pub const CACHED: usize = 64 << 20;
    /// Words of a tree from which on the blocks that a query will visit are prefetched: then they are often not in the
    /// cache, and where they are, a prefetch only costs.
    pub const AHEAD: usize = 8 << 20;
    /// Words of a tree from which on the rows of blocks with many keys are prefetched: `cargo bench --bench keys`.
    pub const KEYED_AHEAD: usize = 1 << 18;
}

/// Trees that are built where queries go.
///
/// `cargo bench --bench lazy`
pub(crate) mod lazy {
    /// Primitives of a subtree at most. Of pictures that test 5 % of the triangles, 1024 take the coarse build a fifth longer and build
    /// about as much; 4096 build a fifth more and take the coarse build hardly less (hall and coherent, `--subtree`).
    pub const SUBTREE: usize = 2048;
    /// Whether a subtree divides the shutter is tried with so small a part of it, and with so many primitives at least.
    pub const SAMPLED: usize = 8;
    pub const LEAST_SAMPLE: usize = 128;
}

/// Which triangles become several references before the build.
///
/// `cargo bench --bench ray_choices -- --only cuts`
pub(crate) mod presplit {
    use core::ops::RangeInclusive;

    /// Pre-splitting is done where the expected cost of a ray falls below this part of what it was: it also takes memory.
    pub const MAX_PRESPLIT_COST: f32 = 0.95;
    /// Where a sample says that pre-splitting makes the cost so large a part of what it was, the next one is tried as well.
    pub const UNCERTAIN_PRESPLIT_COST: RangeInclusive<f32> = 0.9..=1.0;
    /// Pre-splitting is tried where the boxes have at least this many times the area of the triangles in them.
    pub const MIN_AREA_RATIO: f64 = 8.0;
    /// Pre-splitting is decided on neighbourhoods of a sixteenth of all references together, each in these bounds.
    pub const PRESPLIT_SAMPLES: usize = 2;
    pub const PRESPLIT_SAMPLE: RangeInclusive<usize> = 512..=4096;
    /// Only references whose motion is at most this part of their length are cut.
    pub const MAX_MOTION_RATIO: f32 = 0.6;
    /// A part must save at least this times the area of an average reference: it costs memory and a test.
    pub const MIN_SAVING: f32 = 0.2;
    /// The area that is left when nothing can be gained, in areas of the triangle: about that of a triangle in
    /// random position.
    pub const LEAST_AREA: f32 = 4.0;
}

/// Where the shutter is divided.
///
/// `cargo bench --bench ray_choices`
pub(crate) mod slices {
    use core::ops::RangeInclusive;

    /// Pieces that a draft is taken apart into, about, and the fewest references of one.
    pub const PIECES: usize = 256;
    pub const LEAST_PIECE: usize = 1024;
    /// References of a piece that are looked at.
    pub const LOOK: u32 = 64;
    /// Dividing a piece pays where boxes made for each half of the shutter have less than this part of the area.
    pub const MAX_AREA_OF_HALVES: f32 = 0.87;
    /// A region must gain this part of the cost of the whole.
    pub const MIN_GAIN: f32 = 0.002;
    /// Halves of a region whose looseness differs by more than this are regions of their own.
    pub const MAX_DIFFERENCE: f32 = 0.15;
    /// Parts of a region that was refused are compared so many levels below it, where they have this many pieces at least.
    pub const LEVELS: usize = 3;
    pub const FEW: usize = 16;
    /// What a ray waits for is mostly nodes. So segments, which share leaf blocks, count as this part of copies there:
    /// two cost 7 to 30 % more than their steps and tests say, four 20 to 60 % (coherent, debris, tornado, hairball).
    pub const NODE_LATENCY_SHARE: f32 = 0.8;
    /// A division is taken where it costs less than this part of the whole: it takes memory and time to build.
    pub const MAX_SPLIT_COST: f32 = 0.87;
    /// Two segments must cost less than this part of the whole for copies to be tried.
    pub const MAX_TWO_SLICES_COST: f32 = 0.85;
    /// Where the best segments of motion that bends cost at most this times what a tree for a moment costs, copies, which take
    /// several times as long to build, are not tried (`cargo bench --bench keys`).
    pub const NEAR_MOMENT: f32 = 1.25;
    /// Nodes are a quarter to nearly a half of a tree's bytes; leaf blocks are the rest, which segments share.
    pub const NODE_BYTES_SHARE: f32 = 0.45;
    /// A division is decided on so many subtrees, that together are a sixteenth of all references of a region, each of so
    /// many. Smaller ones would say too little for copies: what meets in them at mid-shutter parts company.
    pub const SAMPLES: RangeInclusive<usize> = 4..=6;
    pub const SAMPLE: RangeInclusive<usize> = 2048..=4096;
}

/// Trees over points: which structure, and from which size on memory is waited for.
///
/// `cargo bench --bench neighbor_tables`; prices are the least squares of `cargo bench --bench neighbor_tables -- prices`
pub(crate) mod points {
    /// Samples; points in each, at least and at most, of which each stands for so many of the set.
    pub const SAMPLES: usize = 4;
    pub const SAMPLE: [usize; 2] = [256, 2048];
    pub const SAMPLED: usize = 64;
    /// Searches in all samples, at least and at most, of which each stands for so many points of the set.
    pub const SEARCHES: [usize; 2] = [96, 384];
    pub const SEARCHED: usize = 256;
    /// Price of a block in nodes: a node has twelve rows and leads on, a block has six and does not.
    pub const BLOCK_PRICE: f64 = 0.4;
    /// What a search costs besides when all it touches comes from memory, in nodes. What it visits lies beside each other and is asked
    /// for ahead, so this does not grow with the work.
    pub const COLD: f64 = 26.0;
    /// Bytes of a structure of which half is found in no cache: the more trees searches are spread over, the less one finds of what the one
    /// before has fetched. The fit is nearly as good anywhere from half to five times that; with other bytes go other prices.
    pub const HALF_COLD: f64 = 100e6;
    /// Bytes of a reference with its share of nodes.
    pub const REFERENCE_BYTES: f64 = 32.0;
    /// A structure must be this much cheaper than a smaller one to be taken.
    pub const GAIN: f64 = 0.93;
    /// What a structure must cost in samples, relative to one in the whole set, for a tree of it to be built and looked at. Samples see
    /// too little by some hundredths.
    pub const PROMISE: f64 = 0.87;
    /// A mover is fast when it moves farther, relative to its neighbours, than this many times the size of
    /// a leaf: that which they share at mid-part, or the median of all leaves if that is smaller. (What has left the crowd by
    /// then shares a large leaf with few others.)
    pub const FAST: f64 = 2.0;
    /// A set is divided into what stands still and what does not where at least this share does.
    pub const APART: f64 = 0.5;
    /// Bytes of leaves above which a search finds most of them in no cache.
    pub const FAR: usize = 32 << 20;
    /// Bytes of leaves up to which a search finds most of them in a near cache.
    pub const NEAR: usize = 2 << 20;
}
