//! Little-endian encoding of numbers and of structs of numbers.

use glam::{DVec3, Vec3};

/// A value of a fixed number of bytes. Any bytes decode to a value; validation comes later.
pub(crate) trait Record: Copy {
    /// Number of bytes.
    const BYTES: usize;
    /// Encodes the value into [`Record::BYTES`] bytes.
    fn put(&self, to: &mut [u8]);
    /// Decodes a value from [`Record::BYTES`] bytes.
    fn get(from: &[u8]) -> Self;

    /// Writes several, one behind the other.
    #[inline(always)]
    fn put_all<const N: usize>(items: &[Self; N], to: &mut [u8]) {
        for (item, to) in items.iter().zip(to.chunks_exact_mut(Self::BYTES)) {
            item.put(to);
        }
    }

    /// Reads several, one behind the other.
    #[inline(always)]
    fn get_all<const N: usize>(from: &[u8]) -> [Self; N] {
        // Not by `array::from_fn`, which is called where it should be inlined.
        let mut items = [Self::get(&from[..Self::BYTES]); N];
        for (item, bytes) in items.iter_mut().zip(from.chunks_exact(Self::BYTES)).skip(1) {
            *item = Self::get(bytes);
        }
        items
    }
}

/// Numbers, by their own methods. Arrays of them use plain loops, which compile to copies of memory on little-endian
/// machines: nearly all bytes of a file are such arrays.
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
            #[inline(always)]
            fn put_all<const N: usize>(items: &[$number; N], to: &mut [u8]) {
                let (rows, _) = to[..N * Self::BYTES].as_chunks_mut();
                for (item, bytes) in items.iter().zip(rows) {
                    *bytes = item.to_le_bytes();
                }
            }
            #[inline(always)]
            fn get_all<const N: usize>(from: &[u8]) -> [$number; N] {
                let mut items = [<$number>::default(); N];
                let (rows, _) = from[..N * Self::BYTES].as_chunks();
                for (item, bytes) in items.iter_mut().zip(rows) {
                    *item = <$number>::from_le_bytes(*bytes);
                }
                items
            }
        }
    )*};
}

number!(u8, u32, u64, f32, f64);

impl<T: Record, const N: usize> Record for [T; N] {
    const BYTES: usize = N * T::BYTES;
    #[inline(always)]
    fn put(&self, to: &mut [u8]) {
        T::put_all(self, to);
    }
    #[inline(always)]
    fn get(from: &[u8]) -> [T; N] {
        T::get_all(from)
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
