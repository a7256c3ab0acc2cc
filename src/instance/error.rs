//! Errors in instances and their transforms.

use super::hit::MAX_NESTING;
use crate::error::BuildError;
use crate::limits::MAX_COORDINATE;
use core::fmt;

/// How far from zero the padded bounds of an instance may reach.
pub(super) const MAX_PLACED: f64 = 0.5 * MAX_COORDINATE;

/// Why a tree of instances could not be built.
///
/// ```
/// use mbkd::{BuildParams, Instance, InstanceError, InstanceTree, RayTree, Transform, WideParams};
/// let tree = std::sync::Arc::new(RayTree::build(&[], &BuildParams::default())?);
/// let nowhere = Instance::new(tree, Transform::Matrices(vec![]));
/// let error = InstanceTree::build(vec![nowhere], &WideParams::default()).unwrap_err();
/// assert_eq!(error, InstanceError::NoKeys { instance: 0 });
/// # Ok::<(), mbkd::BuildError>(())
/// ```
#[derive(Clone, Debug, PartialEq)]
#[non_exhaustive]
pub enum InstanceError {
    /// A transform has no key at all.
    NoKeys {
        /// The instance.
        instance: usize,
    },
    /// An entry of a transform is NaN or infinite.
    NonFinite {
        /// The instance.
        instance: usize,
        /// The key.
        key: usize,
    },
    /// A rotation is not a unit quaternion: its length differs from 1 by more than 1e-5.
    NotUnit {
        /// The instance.
        instance: usize,
        /// The key.
        key: usize,
    },
    /// A transform is singular, or so nearly that its inverse is not finite. (One that is zero at all keys is no error: it hides
    /// the instance.)
    Singular {
        /// The instance.
        instance: usize,
        /// The key.
        key: usize,
    },
    /// A transform becomes singular at some time between two keys, or so nearly that it cannot be told apart: entries of matrices,
    /// or scales, are interpolated through zero.
    SingularBetween {
        /// The instance.
        instance: usize,
        /// The key before that time.
        key: usize,
    },
    /// At some time, mapping rays into the instance's space would make rounding grow by more than 2^18. Causes: shear,
    /// near-flattening, or very different scales per axis. For an instance of instances, all levels add up.
    Distorted {
        /// The instance.
        instance: usize,
    },
    /// The instance lies farther from zero than half of [`crate::MAX_COORDINATE`] at some time, with what is added for rounding.
    TooLarge {
        /// The instance.
        instance: usize,
    },
    /// Trees of instances are nested in more levels than [`MAX_NESTING`].
    TooDeep {
        /// The instance.
        instance: usize,
    },
    /// The keys of all instances up to this one are more than 32 bits can number. (Keys on straight lines between others do not
    /// count, once their instance is added.)
    TooManyKeys {
        /// The instance.
        instance: usize,
    },
    /// An error that every build of a tree can return: parameters, too many primitives.
    Build(BuildError),
}

impl fmt::Display for InstanceError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            InstanceError::NoKeys { instance } => {
                write!(f, "instance {instance} has no key: give its transform for at least one time")
            }
            InstanceError::NonFinite { instance, key } => {
                write!(f, "instance {instance}: key {key} of its transform has a NaN or an infinite number")
            }
            InstanceError::NotUnit { instance, key } => {
                write!(f, "instance {instance}: the rotation of key {key} is not a unit quaternion; normalize it")
            }
            InstanceError::Singular { instance, key } => {
                write!(
                    f,
                    "instance {instance}: the transform of key {key} is singular, or nearly; use a small scale such as 1e-6 \
                     instead of 0 (only a scale of 0 along all axes at all keys is taken: it hides the instance)"
                )
            }
            InstanceError::SingularBetween { instance, key } => write!(
                f,
                "instance {instance}: between keys {key} and {} its transform becomes singular, or nearly: if it turns, give poses (scale, \
                 rotation, translation) instead of matrices, with keys less than half a turn apart; if a scale changes its sign, give \
                 two instances, each active on one side of that time",
                key + 1
            ),
            InstanceError::Distorted { instance } => write!(
                f,
                "instance {instance}: its transform, together with those of the instances in it, shears, flattens or scales axes \
                 so differently that rounding grows by more than 2^18; bake a part of it into the vertices, or nest fewer levels"
            ),
            InstanceError::TooLarge { instance } => {
                write!(f, "instance {instance} is placed beyond {:e}; move or scale the scene", MAX_PLACED as f32)
            }
            InstanceError::TooDeep { instance } => {
                write!(
                    f,
                    "instance {instance}: instances are nested more than {MAX_NESTING} levels deep; flatten a level: place the trees of \
                     an inner `InstanceTree` in the outer one, with the products of both transforms"
                )
            }
            InstanceError::TooManyKeys { instance } => write!(
                f,
                "instance {instance}: with its keys, the instances have more than one tree can number (2^32 - 1); give fewer keys, or \
                 divide the instances among several trees"
            ),
            InstanceError::Build(error) => error.fmt(f),
        }
    }
}

impl std::error::Error for InstanceError {}

impl From<BuildError> for InstanceError {
    fn from(error: BuildError) -> InstanceError {
        InstanceError::Build(error)
    }
}
