//! Parameters of photon maps.

use super::error::GatherError;
use crate::point::error::PointError;
use crate::point::params::{PointParams, PointStructure};
use crate::simd::SimdLevel;

/// How a photon map, or a set of visible points, is built. Answers do not depend on it, except that
/// `window` is a limit for photons that move with their surface.
#[derive(Clone, Debug, PartialEq)]
pub struct GatherParams {
    /// The typical half width of the window of queries; default 0.05. The tree is optimized for it. If any
    /// photon moves with its surface, gathers with a wider window return [`GatherError::WindowTooWide`].
    pub window: f32,
    /// The typical number of photons of a query; default 50. The tree is optimized for it.
    pub neighbors: u32,
    /// Structure of photons that exist for a while or move with their surface; default: automatic.
    pub structure: PointStructure,
    /// Instruction set of the queries. Default: the widest of this CPU.
    pub simd: SimdLevel,
}

impl Default for GatherParams {
    fn default() -> Self {
        let simd = SimdLevel::best();
        GatherParams { window: 0.05, neighbors: 50, structure: PointStructure::Automatic, simd }
    }
}

impl GatherParams {
    /// Checks that every field is in its range.
    ///
    /// ```
    /// use mbkd::point::{GatherError, GatherParams};
    /// let wrong = GatherParams { neighbors: 0, ..GatherParams::default() };
    /// assert!(matches!(wrong.validate(), Err(GatherError::Parameter { name: "neighbors", .. })));
    /// ```
    ///
    /// # Errors
    /// [`GatherError::Parameter`] with the name of the first field that is not.
    pub fn validate(&self) -> Result<(), GatherError> {
        if self.window.is_nan() || self.window <= 0.0 {
            return Err(GatherError::Parameter { name: "window", expected: "greater than 0" });
        }
        if self.neighbors == 0 {
            return Err(GatherError::Parameter { name: "neighbors", expected: "at least 1" });
        }
        // Checked for all maps, though it only matters to photons that exist for a while or move.
        match (PointParams { structure: self.structure, ..PointParams::default() }).validate() {
            Err(PointError::Parameter { name, expected }) => Err(GatherError::Parameter { name, expected }),
            _ => Ok(()),
        }
    }
}
