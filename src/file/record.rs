//! Little-endian encoding of numbers and of structs of numbers.

use glam::{DVec3, Vec3};

/// A value of a fixed number of bytes. Any bytes decode to a value; validation comes later.
pub(crate) trait Record: Sized {
    /// Number of bytes.
    const BYTES: usize;
    /// Encodes the value into [`Record::BYTES`] bytes.
    fn put(&self, to: &mut [u8]);
    /// Decodes a value from [`Record::BYTES`] bytes.
    fn get(from: &[u8]) -> Self;
}

/// Numbers, by their own methods.
macro_rules! number {
    ($($number:ty),*) => {$(
        impl Record for $number {
            const BYTES: usize = size_of::<$number>();
            #[inline(always)]
            fn put(&self, to: &mut [u8]) {
                to.copy_from_slice(&self.to_le_bytes());
            }
            #[inline(always)]
            fn get(from: &[u8]) -> $number {
                let mut bytes = [0; size_of::<$number>()];
                bytes.copy_from_slice(from);
                <$number>::from_le_bytes(bytes)
            }
        }
    )*};
}

number!(u8, u32, u64, f32, f64);

impl<T: Record, const N: usize> Record for [T; N] {
    const BYTES: usize = N * T::BYTES;
    #[inline(always)]
    fn put(&self, to: &mut [u8]) {
        for (item, to) in self.iter().zip(to.chunks_exact_mut(T::BYTES)) {
            item.put(to);
        }
    }
    #[inline(always)]
    fn get(from: &[u8]) -> [T; N] {
        core::array::from_fn(|i| T::get(&from[i * T::BYTES..(i + 1) * T::BYTES]))
    }
}

/// A struct whose fields follow each other in a file in the given order.
macro_rules! record_fields {
    ($of:ident { $($field:tt: $type:ty),* $(,)? }) => {
        impl $crate::file::Record for $of {
            const BYTES: usize = 0 $(+ <$type as $crate::file::Record>::BYTES)*;
            #[inline(always)]
            fn put(&self, to: &mut [u8]) {
                let mut rest = to;
                $(
                    let (bytes, more) = rest.split_at_mut(<$type as $crate::file::Record>::BYTES);
                    <$type as $crate::file::Record>::put(&self.$field, bytes);
                    rest = more;
                )*
                debug_assert!(rest.is_empty());
            }
            #[inline(always)]
            fn get(from: &[u8]) -> $of {
                let mut rest = from;
                let record = $of {
                    $($field: {
                        let (bytes, more) = rest.split_at(<$type as $crate::file::Record>::BYTES);
                        rest = more;
                        <$type as $crate::file::Record>::get(bytes)
                    }),*
                };
                debug_assert!(rest.is_empty());
                record
            }
        }
    };
}

pub(crate) use record_fields;

impl Record for Vec3 {
    const BYTES: usize = 12;
    #[inline(always)]
    fn put(&self, to: &mut [u8]) {
        self.to_array().put(to);
    }
    #[inline(always)]
    fn get(from: &[u8]) -> Vec3 {
        Vec3::from_array(Record::get(from))
    }
}

impl Record for DVec3 {
    const BYTES: usize = 24;
    #[inline(always)]
    fn put(&self, to: &mut [u8]) {
        self.to_array().put(to);
    }
    #[inline(always)]
    fn get(from: &[u8]) -> DVec3 {
        DVec3::from_array(Record::get(from))
    }
}
