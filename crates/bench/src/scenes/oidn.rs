//! Intel Open Image Denoise (OIDN 2), found when it is asked for: nothing of it is linked, built or shipped.
//!
//! The C interface is that of OIDN's documentation (<https://www.openimagedenoise.org/documentation.html>); of it the few functions are
//! used that filter one HDR image with albedo and normals beside it, on the CPU.

use corf_raytrace::light::LightFrame;
use corf_raytrace::sensor::Denoise;
use corf_scene::config::{DatasetConfig, Denoiser};
use corf_scene::{Error, Raster, Result};
use libloading::{Library, Symbol};
use std::ffi::{CStr, c_char, c_int, c_void};
use std::path::PathBuf;

/// Names the library file, where the system's loader does not find it by itself.
pub const LIBRARY_VARIABLE: &str = "CORF_OIDN_LIBRARY";
/// File names of the library on Linux, macOS and Windows.
const NAMES: [&str; 4] =
    ["libOpenImageDenoise.so.2", "libOpenImageDenoise.so", "libOpenImageDenoise.2.dylib", "OpenImageDenoise.dll"];

/// `OIDN_DEVICE_TYPE_CPU` and `OIDN_FORMAT_FLOAT3`.
const DEVICE_CPU: c_int = 1;
const FORMAT_FLOAT3: c_int = 3;
/// The interface that is written down here is that of this major version.
const MAJOR_VERSION: c_int = 2;

type Handle = *mut c_void;
type SetFilterImage = unsafe extern "C" fn(Handle, *const c_char, *mut c_void, c_int, usize, usize, usize, usize, usize);

/// The library and its device on the CPU.
pub struct Oidn {
    library: Library,
    device: Handle,
    version: [c_int; 3],
}

// SAFETY: OIDN's documentation: all its functions may be called from any thread; calls on one device are serialised by the library.
unsafe impl Send for Oidn {}
// SAFETY: as above.
unsafe impl Sync for Oidn {}

impl Oidn {
    /// The filter, if a dataset asks for it.
    ///
    /// # Errors
    /// It is not on this machine.
    pub fn asked_for(config: &DatasetConfig) -> Result<Option<Self>> {
        let place = || format!("{}: optical.denoiser", config.source.display());
        config.light.denoiser.map(|Denoiser::Oidn| Self::find(&place())).transpose()
    }

    /// Loads the library that [`LIBRARY_VARIABLE`] names, or else the system's, and makes its CPU device ready. `place` says who asks.
    ///
    /// # Errors
    /// It is not there, or no version 2; the message says how to get it.
    pub fn find(place: &str) -> Result<Self> {
        let library = load(place)?;
        let mut oidn = Self { library, device: std::ptr::null_mut(), version: [0; 3] };
        oidn.start().map_err(|what| refused(place, what))?;
        if oidn.version[0] != MAJOR_VERSION {
            return Err(refused(place, format!("{} was found where version {MAJOR_VERSION} is needed", oidn.name())));
        }
        Ok(oidn)
    }

    /// Name and version, as a dataset records them.
    pub fn name(&self) -> String {
        let [major, minor, patch] = self.version;
        format!("Intel Open Image Denoise {major}.{minor}.{patch}")
    }

    fn start(&mut self) -> Result<(), String> {
        // SAFETY: the signatures are those of OIDN 2's C interface (and, for these, of OIDN 1's).
        unsafe {
            let new: Symbol<'_, unsafe extern "C" fn(c_int) -> Handle> = self.get(c"oidnNewDevice")?;
            self.device = new(DEVICE_CPU);
            if self.device.is_null() {
                return Err(self.last_error().unwrap_or_else(|| "it has no device for this processor".into()));
            }
            let version: Symbol<'_, unsafe extern "C" fn(Handle, *const c_char) -> c_int> = self.get(c"oidnGetDeviceInt")?;
            self.version = [c"versionMajor", c"versionMinor", c"versionPatch"].map(|key| version(self.device, key.as_ptr()));
            if self.version[0] == MAJOR_VERSION {
                // Other threads of this program want the cores as well.
                let set: Symbol<'_, unsafe extern "C" fn(Handle, *const c_char, bool)> = self.get(c"oidnSetDeviceBool")?;
                set(self.device, c"setAffinity".as_ptr(), false);
                let threads: Symbol<'_, unsafe extern "C" fn(Handle, *const c_char, c_int)> = self.get(c"oidnSetDeviceInt")?;
                threads(self.device, c"numThreads".as_ptr(), rayon::current_num_threads() as c_int);
            }
            self.call(c"oidnCommitDevice", self.device)?;
        }
        self.last_error().map_or(Ok(()), Err)
    }

    fn filter(
        &self,
        color: &Raster<[f32; 3]>,
        albedo: &Raster<[f32; 3]>,
        normal: &Raster<[f32; 3]>,
    ) -> Result<Vec<[f32; 3]>, String> {
        let (width, height) = (color.width(), color.height());
        let mut output = vec![[0.0_f32; 3]; width * height];
        let inputs = [(c"color", color), (c"albedo", albedo), (c"normal", normal)];
        // SAFETY: the four images are packed arrays of width × height × 3 floats that outlive the filter; the library writes to `output`
        // alone, and has ended when `oidnExecuteFilter` returns.
        unsafe {
            let new: Symbol<'_, unsafe extern "C" fn(Handle, *const c_char) -> Handle> = self.get(c"oidnNewFilter")?;
            let image: Symbol<'_, SetFilterImage> = self.get(c"oidnSetSharedFilterImage")?;
            let flag: Symbol<'_, unsafe extern "C" fn(Handle, *const c_char, bool)> = self.get(c"oidnSetFilterBool")?;
            let filter = new(self.device, c"RT".as_ptr());
            for (name, input) in inputs {
                let pixels = input.pixels().as_ptr().cast_mut().cast();
                image(filter, name.as_ptr(), pixels, FORMAT_FLOAT3, width, height, 0, 0, 0);
            }
            image(filter, c"output".as_ptr(), output.as_mut_ptr().cast(), FORMAT_FLOAT3, width, height, 0, 0, 0);
            flag(filter, c"hdr".as_ptr(), true);
            self.call(c"oidnCommitFilter", filter)?;
            self.call(c"oidnExecuteFilter", filter)?;
            self.call(c"oidnReleaseFilter", filter)?;
        }
        self.last_error().map_or(Ok(output), Err)
    }

    /// The library's error since the last call, if there was one.
    fn last_error(&self) -> Option<String> {
        // SAFETY: the signature is OIDN's; the message is the library's own and is copied at once.
        unsafe {
            let get: Symbol<'_, unsafe extern "C" fn(Handle, *mut *const c_char) -> c_int> =
                self.get(c"oidnGetDeviceError").ok()?;
            let mut message: *const c_char = std::ptr::null();
            if get(self.device, &mut message) == 0 {
                return None;
            }
            Some(if message.is_null() { "an error".into() } else { CStr::from_ptr(message).to_string_lossy().into_owned() })
        }
    }

    /// A function of the library.
    ///
    /// # Safety
    /// `T` is the function's signature.
    unsafe fn get<T>(&self, name: &CStr) -> Result<Symbol<'_, T>, String> {
        // SAFETY: the caller's.
        unsafe { self.library.get(name.to_bytes_with_nul()) }.map_err(|e| e.to_string())
    }

    /// Calls a function that takes one handle and gives nothing back.
    ///
    /// # Safety
    /// The library's function `name` is such a one, and `handle` is what it takes.
    unsafe fn call(&self, name: &CStr, handle: Handle) -> Result<(), String> {
        // SAFETY: the caller's.
        unsafe {
            let function: Symbol<'_, unsafe extern "C" fn(Handle)> = self.get(name)?;
            function(handle);
        }
        Ok(())
    }
}

impl Denoise for Oidn {
    /// Takes the noise out of a frame's radiance, guided by its albedo and normals. What is seen of lamps straight has none and stays.
    ///
    /// # Errors
    /// The library's error (out of memory).
    fn denoise(&self, frame: &mut LightFrame) -> Result<()> {
        let straight = frame.lamp.pixels();
        let scattered = frame.radiance.pixels().iter().zip(straight).map(|(r, l)| std::array::from_fn(|c| r[c] - l[c]));
        let (width, height) = (frame.radiance.width(), frame.radiance.height());
        let noisy: Raster<[f32; 3]> = Raster::from_vec(width, height, scattered.collect());
        let failed = |what| Error::invalid("denoising", what, "give fewer pixels, or leave `denoiser` out");
        let clean = self.filter(&noisy, &frame.albedo, &frame.normal).map_err(failed)?;
        let whole = clean.iter().zip(straight).map(|(c, l)| std::array::from_fn(|i| c[i].max(0.0) + l[i]));
        frame.radiance = Raster::from_vec(width, height, whole.collect());
        Ok(())
    }
}

impl Drop for Oidn {
    fn drop(&mut self) {
        if !self.device.is_null() {
            // SAFETY: the device is this one's, and nobody has it after.
            let released = unsafe { self.call(c"oidnReleaseDevice", self.device) };
            debug_assert!(released.is_ok(), "a library with devices releases them");
        }
    }
}

fn load(place: &str) -> Result<Library> {
    let named = std::env::var_os(LIBRARY_VARIABLE).map(PathBuf::from);
    let candidates = named.clone().map_or_else(|| NAMES.map(PathBuf::from).to_vec(), |name| vec![name]);
    let mut said = Vec::new();
    for candidate in candidates {
        // SAFETY: the file is one that the user named or that the system knows as OIDN; loading it runs its initialisers, as linking would.
        match unsafe { Library::new(&candidate) } {
            Ok(library) => return Ok(library),
            Err(e) => said.push(e.to_string()),
        }
    }
    let what = match named {
        Some(name) => format!("{LIBRARY_VARIABLE}={} cannot be loaded: {}", name.display(), said.join("; ")),
        None => "Intel Open Image Denoise is not on this machine".into(),
    };
    Err(refused(place, what))
}

fn refused(place: &str, what: impl Into<String>) -> Error {
    Error::invalid(
        place,
        what,
        format!(
            "install Open Image Denoise 2 (from openimagedenoise.org, a system package, or `pip install pyoidn`, whose folder \
             pyoidn/oidn/lib holds it) and, if the loader does not find it, set {LIBRARY_VARIABLE} to the file \
             libOpenImageDenoise.so.2; or leave `denoiser` out"
        ),
    )
}
