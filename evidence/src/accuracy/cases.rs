//! The test inputs: one family per numerical difficulty, each over its range.

/// A scene of moving triangles (or spheres) and rays into it. Lengths are in units of the scene's size.
#[derive(Clone, Debug)]
pub struct RayCase {
    /// Family and value, for the table.
    pub name: (&'static str, String),
    /// Size of the scene.
    pub scale: f64,
    /// The position of the scene, in sizes.
    pub offset: f64,
    /// Half the width of a ground beside the small triangles, in absolute units, not in sizes.
    pub ground: Option<f64>,
    /// The distance of one more small triangle.
    pub outlier: Option<f64>,
    /// The distance of ray origins.
    pub away: f64,
    /// Length of a triangle over its width.
    pub aspect: f64,
    /// The displacement during the shutter.
    pub speed: f64,
    /// Keys of the motion.
    pub keys: usize,
    /// Length of directions.
    pub direction: f64,
    /// Whether vertices are given in f64.
    pub wide: bool,
    /// Whether those are stored in f64 ([`TriangleMesh::precise`](mbkd::TriangleMesh::precise)).
    pub kept: bool,
    /// Whether queries are at times at which triangles cross planes of k-d trees, and up to three floats beside.
    pub at_crossings: bool,
}

impl RayCase {
    /// Whether rays begin within the distance for which the library guarantees answers: 2^32 scene sizes.
    pub fn is_promised(&self) -> bool {
        self.away <= 4294967296.0
    }

    fn plain(family: &'static str, value: String) -> RayCase {
        RayCase {
            name: (family, value),
            scale: 1.0,
            offset: 0.0,
            ground: None,
            outlier: None,
            away: 3.0,
            aspect: 1.0,
            speed: 0.3,
            keys: 2,
            direction: 1.0,
            wide: false,
            kept: false,
            at_crossings: false,
        }
    }
}

fn number(x: f64) -> String {
    if (0.001..10_000.0).contains(&x.abs()) || x == 0.0 { format!("{x}") } else { format!("{x:.0e}") }
}

/// One case per value.
fn family<T>(
    name: &'static str,
    values: &[f64],
    plain: impl Fn(&'static str, String) -> T,
    set: impl Fn(&mut T, f64),
) -> Vec<T> {
    let case = |&value: &f64| {
        let mut case = plain(name, number(value));
        set(&mut case, value);
        case
    };
    values.iter().map(case).collect()
}

/// The cases for triangles.
pub fn ray_cases() -> Vec<RayCase> {
    let of = RayCase::plain;
    let crossing = |family, value| RayCase { at_crossings: true, ..RayCase::plain(family, value) };
    let kept = |family, value| RayCase { wide: true, kept: true, ..RayCase::plain(family, value) };
    [
        family("scale", &[1e-12, 1e-6, 1.0, 1e6, 1e12], of, |c, x| c.scale = x),
        family("offset", &[1.0, 1e2, 1e4, 1e6], of, |c, x| c.offset = x),
        family("beside a ground", &[1e2, 1e4, 1e6, 1e7], of, |c, x| {
            c.ground = Some(x);
            c.scale = 0.01;
        }),
        family("one outlier", &[1e4, 1e6, 1e9], of, |c, x| c.outlier = Some(x)),
        family("far origins", &[1e4, 1e6, 1e8, 1e12], of, |c, x| c.away = x),
        family("aspect", &[1.0, 1e2, 1e4, 1e6, 1e8], of, |c, x| c.aspect = x),
        family("speed", &[0.0, 1.0, 1e3, 1e6], of, |c, x| c.speed = x),
        family("keys", &[1.0, 2.0, 3.0, 17.0, 257.0], of, |c, x| c.keys = x as usize),
        family("direction length", &[1e-42, 1e-38, 1e-20, 1e20, 1e37], of, |c, x| c.direction = x),
        family("f64, offset", &[0.0, 1e6, 1e9], of, |c, x| {
            c.wide = true;
            c.offset = x;
        }),
        family("f64 kept, offset", &[0.0, 1e6, 1e9], kept, |c, x| c.offset = x),
        family("f64 kept, clusters apart", &[1e4, 1e7, 1e9], kept, |c, x| {
            c.offset = x;
            c.outlier = Some(x);
        }),
        family("f64 kept, keys", &[1.0, 3.0, 17.0], kept, |c, x| {
            c.offset = 1e6;
            c.keys = x as usize;
        }),
        family("crossing times, speed", &[0.3, 1.0, 1e3], crossing, |c, x| c.speed = x),
        family("crossing times, keys", &[3.0, 17.0], crossing, |c, x| c.keys = x as usize),
    ]
    .concat()
}

/// Those of them that are relevant for closest points, which have no rays.
pub fn closest_point_cases() -> Vec<RayCase> {
    let of_rays = ["far origins", "direction length"];
    ray_cases().into_iter().filter(|case| !of_rays.contains(&case.name.0)).collect()
}

/// The cases for spheres.
pub fn sphere_cases() -> Vec<RayCase> {
    let of = RayCase::plain;
    [
        family("scale", &[1e-12, 1.0, 1e12], of, |c, x| c.scale = x),
        family("offset", &[1e4, 1e6], of, |c, x| c.offset = x),
        family("beside a ground", &[1e4, 1e6, 1e7], of, |c, x| {
            c.ground = Some(x);
            c.scale = 0.01;
        }),
        family("one outlier", &[1e6], of, |c, x| c.outlier = Some(x)),
        family("far origins", &[1e4, 1e6, 1e8], of, |c, x| c.away = x),
        family("speed", &[0.0, 1e3, 1e6], of, |c, x| c.speed = x),
        family("keys", &[1.0, 17.0, 257.0], of, |c, x| c.keys = x as usize),
    ]
    .concat()
}

/// Moving points and queries among them. Lengths are in units of the set's size.
#[derive(Clone, Debug)]
pub struct PointCase {
    /// Family and value, for the table.
    pub name: (&'static str, String),
    /// Size of the set.
    pub scale: f64,
    /// Its position, in sizes.
    pub offset: f64,
    /// The distance between two clusters.
    pub clusters: Option<f64>,
    /// The distance of one more point.
    pub outlier: Option<f64>,
    /// The displacement of points during the shutter.
    pub speed: f64,
    /// Keys of the motion.
    pub keys: usize,
    /// Whether positions are given in f64.
    pub wide: bool,
    /// Whether queries are at times at which points cross planes of k-d trees, and up to three floats beside.
    pub at_crossings: bool,
}

impl PointCase {
    fn plain(family: &'static str, value: String) -> PointCase {
        PointCase {
            name: (family, value),
            scale: 1.0,
            offset: 0.0,
            clusters: None,
            outlier: None,
            speed: 0.1,
            keys: 2,
            wide: false,
            at_crossings: false,
        }
    }
}

/// The cases for points.
pub fn point_cases() -> Vec<PointCase> {
    let of = PointCase::plain;
    let crossing = |family, value| PointCase { at_crossings: true, ..PointCase::plain(family, value) };
    [
        family("scale", &[1e-12, 1e-6, 1.0, 1e6, 1e12], of, |c, x| c.scale = x),
        family("offset", &[1.0, 1e2, 1e4, 1e6], of, |c, x| c.offset = x),
        family("clusters apart", &[1e2, 1e4, 1e7], of, |c, x| c.clusters = Some(x)),
        family("one outlier", &[1e6], of, |c, x| c.outlier = Some(x)),
        family("speed", &[0.0, 1.0, 1e3, 1e6], of, |c, x| c.speed = x),
        family("keys", &[1.0, 2.0, 3.0, 17.0, 257.0], of, |c, x| c.keys = x as usize),
        family("f64, offset", &[0.0, 1e6, 1e9], of, |c, x| {
            c.wide = true;
            c.offset = x;
        }),
        family("f64, clusters apart", &[1e4, 1e7], of, |c, x| {
            c.wide = true;
            c.clusters = Some(x);
        }),
        family("f64, still, clusters apart", &[1e7], of, |c, x| {
            c.wide = true;
            c.keys = 1;
            c.clusters = Some(x);
        }),
        family("crossing times, speed", &[0.3, 1.0, 1e3], crossing, |c, x| c.speed = x),
        family("crossing times, keys", &[3.0, 17.0], crossing, |c, x| c.keys = x as usize),
    ]
    .concat()
}
