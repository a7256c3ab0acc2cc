//! Our side: one tree with default parameters, without settings per scene.

use crate::options::Isa;
use mbkd::{BuildParams, ClosestPoint, ClosestPointQuery, Counters, Hit, Ray, RayTree, SimdLevel, TriangleMesh};
use mbkd_evidence::scene_rays::Kind;
use rayon::{ThreadPool, ThreadPoolBuilder};
use std::sync::Arc;

/// A pool of this many threads (0: all cores).
pub fn pool(threads: usize) -> Result<Arc<ThreadPool>, String> {
    ThreadPoolBuilder::new().num_threads(threads).build().map(Arc::new).map_err(|e| e.to_string())
}

/// A tree, and the threads that built it and answer its batches.
pub struct Ours {
    tree: RayTree,
    pool: Arc<ThreadPool>,
}

impl Ours {
    /// Builds with the threads of a pool, which later answer batches.
    pub fn build(meshes: &[TriangleMesh], pool: &Arc<ThreadPool>) -> Result<Ours, String> {
        let tree = pool.install(|| RayTree::build(meshes, &BuildParams::default()));
        Ok(Ours { tree: tree.map_err(|e| e.to_string())?, pool: Arc::clone(pool) })
    }

    /// Builds on one thread, for queries with these instructions.
    pub fn alone(meshes: &[TriangleMesh], isa: Isa) -> Result<Ours, String> {
        let ours = Ours::build(meshes, &pool(1)?)?;
        if isa == Isa::Avx2 { ours.with_avx2() } else { Ok(ours) }
    }

    /// The same tree, with queries limited to AVX2.
    pub fn with_avx2(self) -> Result<Ours, String> {
        let level = SimdLevel::available().into_iter().find(|level| level.name() == "avx2");
        let level = level.ok_or("this CPU has no AVX2")?;
        Ok(Ours { tree: self.tree.with_simd(level), pool: self.pool })
    }

    /// The tree.
    pub fn tree(&self) -> &RayTree {
        &self.tree
    }

    /// Bytes of the tree and its triangles.
    pub fn bytes(&self) -> usize {
        let statistics = self.tree.statistics();
        statistics.bytes + statistics.primitive_bytes
    }

    #[inline]
    pub fn closest_hit(&self, ray: &Ray) -> Option<Hit> {
        self.tree.closest_hit(ray)
    }

    #[inline]
    pub fn any_hit(&self, ray: &Ray) -> bool {
        self.tree.any_hit(ray)
    }

    #[inline]
    pub fn closest_point(&self, query: &ClosestPointQuery) -> Option<ClosestPoint> {
        self.tree.closest_point(query)
    }

    /// The total work of the single queries of a kind.
    pub fn work(&self, kind: Kind, rays: &[Ray]) -> Counters {
        let mut counters = Counters::default();
        for ray in rays {
            match kind {
                Kind::Ao => _ = self.tree.any_hit_observed(ray, &mut counters),
                _ => _ = self.tree.closest_hit_observed(ray, &mut counters),
            }
        }
        counters
    }

    pub fn closest_hits(&self, rays: &[Ray], hits: &mut Vec<Option<Hit>>) {
        self.pool.install(|| self.tree.closest_hits(rays, hits));
    }

    pub fn any_hits(&self, rays: &[Ray], hits: &mut Vec<bool>) {
        self.pool.install(|| self.tree.any_hits(rays, hits));
    }
}
