//! Checks of trees: those read from files, and finished ones.

pub(super) mod kd_check;
pub(super) mod kd_validate;
pub(super) mod lazy_validate;
pub(super) mod validation_error;
pub(super) mod wide_check;
pub(super) mod wide_validate;
