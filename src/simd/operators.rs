//! The operators of lanes.

/// Implements operators, each written as a function of both operands.
macro_rules! operators {
    ($of:ident: $($operator:ident $method:ident |$a:pat_param, $b:pat_param| $result:expr;)*) => {$(
        impl core::ops::$operator for $of {
            type Output = $of;

            #[inline(always)]
            fn $method(self, other: $of) -> $of {
                let ($a, $b) = (self, other);
                $result
            }
        }
    )*};
}

pub(super) use operators;
