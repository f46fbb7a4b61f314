//! Records that the host writes and kernels read: one list of fields, from which the Rust struct and its declaration in WGSL follow.

/// A type that has the same bytes in Rust and in WGSL.
pub trait Wgsl: bytemuck::Pod {
    /// Whether it is a number by itself: two to four of them are a vector.
    const IS_NUMBER: bool = false;
    /// What its place in a record is a multiple of, bytes.
    const ALIGNMENT: usize;

    /// Its name in WGSL.
    fn name() -> String;
}

impl Wgsl for f32 {
    const IS_NUMBER: bool = true;
    const ALIGNMENT: usize = 4;

    fn name() -> String {
        "f32".to_owned()
    }
}

impl Wgsl for u32 {
    const IS_NUMBER: bool = true;
    const ALIGNMENT: usize = 4;

    fn name() -> String {
        "u32".to_owned()
    }
}

/// A vector of numbers, or an array of anything else.
impl<T: Wgsl, const N: usize> Wgsl for [T; N]
where
    Self: bytemuck::Pod,
{
    const ALIGNMENT: usize = if T::IS_NUMBER {
        assert!(N >= 2 && N <= 4, "two to four numbers are a vector, and others are not laid out alike");
        4 * N.next_power_of_two()
    } else {
        assert!(size_of::<T>().is_multiple_of(16), "elements of an array in a uniform are 16 bytes apart, or a multiple");
        T::ALIGNMENT
    };

    fn name() -> String {
        if T::IS_NUMBER { format!("vec{N}<{}>", T::name()) } else { format!("array<{}, {N}>", T::name()) }
    }
}

/// Declares a record: a `#[repr(C)]` struct of plain numbers, [`Wgsl`], with a function `declaration` that says the same in WGSL. A field
/// that WGSL would put elsewhere than Rust does is refused by the compiler: order the fields otherwise, or name the padding.
///
/// ```
/// corf_gpu::record! {
///     /// A lamp.
///     pub struct Lamp {
///         /// Where it is, metres.
///         pub position: [f32; 3],
///         pub power: f32,
///         pub size: [u32; 4],
///     }
/// }
/// assert_eq!(Lamp::declaration(), "struct Lamp {\n    position: vec3<f32>,\n    power: f32,\n    size: vec4<u32>,\n}\n");
/// ```
///
/// ```compile_fail
/// corf_gpu::record! {
///     struct Lamp {
///         power: f32,
///         position: [f32; 3],
///     }
/// }
/// ```
#[macro_export]
macro_rules! record {
    ($(#[$about:meta])* $seen:vis struct $name:ident { $($(#[$note:meta])* $access:vis $field:ident: $kind:ty,)+ }) => {
        $(#[$about])*
        #[derive(Clone, Copy, Debug, Default, bytemuck::Pod, bytemuck::Zeroable)]
        #[repr(C)]
        $seen struct $name {
            $($(#[$note])* $access $field: $kind,)+
        }

        impl $crate::Wgsl for $name {
            const ALIGNMENT: usize = {
                let mut largest = 4;
                $(if <$kind as $crate::Wgsl>::ALIGNMENT > largest {
                    largest = <$kind as $crate::Wgsl>::ALIGNMENT;
                })+
                largest
            };

            fn name() -> String {
                stringify!($name).to_owned()
            }
        }

        impl $name {
            /// The record in WGSL.
            $seen fn declaration() -> String {
                let fields = [$(format!("    {}: {},\n", stringify!($field), <$kind as $crate::Wgsl>::name())),+];
                format!("struct {} {{\n{}}}\n", stringify!($name), fields.concat())
            }
        }

        const _: () = {
            $(assert!(
                std::mem::offset_of!($name, $field).is_multiple_of(<$kind as $crate::Wgsl>::ALIGNMENT),
                concat!("WGSL puts the field ", stringify!($field), " elsewhere")
            );)+
            assert!(size_of::<$name>().is_multiple_of(<$name as $crate::Wgsl>::ALIGNMENT), "WGSL pads the end of the record");
        };
    };
}

#[cfg(test)]
mod tests {
    record! {
        struct Inner {
            numbers: [u32; 3],
            x: f32,
        }
    }
    record! {
        struct Outer {
            at: [f32; 2],
            count: u32,
            padding: u32,
            rows: [[f32; 4]; 3],
            inner: [Inner; 2],
        }
    }

    #[test]
    fn vectors_arrays_and_records_in_records_have_their_names() {
        let outer = "struct Outer {\n    at: vec2<f32>,\n    count: u32,\n    padding: u32,\n    rows: array<vec4<f32>, 3>,\n    inner: array<Inner, 2>,\n}\n";
        assert_eq!(Outer::declaration(), outer);
        assert_eq!(Inner::declaration(), "struct Inner {\n    numbers: vec3<u32>,\n    x: f32,\n}\n");
    }
}
