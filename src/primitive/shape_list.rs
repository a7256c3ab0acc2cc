//! Lists of shapes with their type erased.
//!
//! Builders and queries are compiled for each instruction set. If they were compiled for the caller's types too, every program
//! with a primitive of its own would compile all of them again. So they are compiled once, in this crate, and reach the caller's
//! code through `dyn`. The shapes of one type stay side by side in memory.

use super::custom::Primitive;
use super::shape::Shape;
use super::sphere::MovingSphere;
use crate::parallel::{self, CHUNK};
use core::any::Any;

/// Shapes of one type.
pub(crate) trait ShapeList: Any + Send + Sync {
    fn count(&self) -> usize;
    fn shape(&self, index: usize) -> &dyn Primitive;
    /// Drops the keys that the shapes do not need.
    fn merge_keys(&mut self);
    fn bytes(&self) -> usize;
}

/// The list of a scene without shapes.
pub(crate) fn no_shapes() -> Box<dyn ShapeList> {
    Box::new(Vec::<MovingSphere>::new())
}

impl<P: Primitive + 'static> ShapeList for Vec<P> {
    fn count(&self) -> usize {
        self.len()
    }

    #[inline]
    fn shape(&self, index: usize) -> &dyn Primitive {
        &self[index]
    }

    fn merge_keys(&mut self) {
        let mut parts: Vec<_> = self.chunks_mut(CHUNK).collect();
        parallel::each(&mut parts, |part| part.iter_mut().for_each(P::merge_keys));
    }

    fn bytes(&self) -> usize {
        self.capacity() * size_of::<P>()
    }
}

impl dyn ShapeList {
    /// The sphere, if a shape is that and nothing else. (Other types that name a sphere may know more.)
    pub fn plain_sphere(&self, index: usize) -> Option<&MovingSphere> {
        let list: &dyn Any = self;
        if let Some(spheres) = list.downcast_ref::<Vec<MovingSphere>>() {
            return spheres.get(index);
        }
        match list.downcast_ref::<Vec<Shape>>()?.get(index)? {
            Shape::Sphere(sphere) => Some(sphere),
            Shape::Custom(_) => None,
        }
    }
}
