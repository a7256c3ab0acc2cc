//! Transforms as the caller gives them.

use glam::{DAffine3, DMat3, DQuat, DVec3};

/// A scaling, then a rotation, then a translation.
///
/// ```
/// use mbkd::{Pose, glam::{DQuat, DVec3}};
/// let quarter = Pose { rotation: DQuat::from_rotation_z(core::f64::consts::FRAC_PI_2), ..Pose::IDENTITY };
/// let at = quarter.matrix().transform_point3(DVec3::X);
/// assert!(at.abs_diff_eq(DVec3::Y, 1e-15));
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Pose {
    /// Factors along the axes of the instanced tree's own space. None may be zero, unless all are zero at all keys: that hides the
    /// instance ([`InstanceTree::build`](crate::InstanceTree::build)).
    pub scale: DVec3,
    /// A unit quaternion.
    pub rotation: DQuat,
    /// The position of the origin of the instanced tree's own space.
    pub translation: DVec3,
}

impl Pose {
    /// The identity.
    pub const IDENTITY: Pose = Pose { scale: DVec3::ONE, rotation: DQuat::IDENTITY, translation: DVec3::ZERO };

    /// The pose as a matrix, of its rotation as instances have it: of length 1.
    pub fn matrix(&self) -> DAffine3 {
        let rotation = DMat3::from_quat(self.rotation.normalize());
        DAffine3 { matrix3: rotation * DMat3::from_diagonal(self.scale), translation: self.translation }
    }
}

/// The motion of an instance during the shutter: one or more keys, spaced evenly over it like those of meshes. An
/// instance with one key is static.
///
/// ```
/// use mbkd::{Pose, Transform, glam::{DAffine3, DQuat, DVec3}};
/// let still: Transform = DAffine3::from_translation(DVec3::X).into();
/// // A third of a turn.
/// let turn = |angle: f64| Pose { rotation: DQuat::from_rotation_y(angle), ..Pose::IDENTITY };
/// let wheel: Transform = vec![turn(0.0), turn(2.1)].into();
/// assert!(matches!((still, wheel), (Transform::Matrices(_), Transform::Poses(_))));
/// ```
#[derive(Clone, Debug, PartialEq)]
pub enum Transform {
    /// Affine matrices. Between keys their entries are interpolated linearly: points move on straight lines.
    Matrices(Vec<DAffine3>),
    /// Scale, rotation, translation. Between keys scale and translation are interpolated linearly and the rotation
    /// turns uniformly about one axis, the shorter way (slerp; Shoemake, "Animating Rotation with Quaternion
    /// Curves", 1985): points move on arcs. A rotation by half a turn or more needs keys between.
    Poses(Vec<Pose>),
}

impl Default for Transform {
    fn default() -> Transform {
        Transform::Poses(vec![Pose::IDENTITY])
    }
}

impl From<DAffine3> for Transform {
    fn from(matrix: DAffine3) -> Transform {
        Transform::Matrices(vec![matrix])
    }
}

impl From<Vec<DAffine3>> for Transform {
    fn from(keys: Vec<DAffine3>) -> Transform {
        Transform::Matrices(keys)
    }
}

impl From<Pose> for Transform {
    fn from(pose: Pose) -> Transform {
        Transform::Poses(vec![pose])
    }
}

impl From<Vec<Pose>> for Transform {
    fn from(keys: Vec<Pose>) -> Transform {
        Transform::Poses(keys)
    }
}
