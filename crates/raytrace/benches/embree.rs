//! Rays per second beside Embree 3's single-ray kernels: one mesh, one set of rays, one thread, one run.
//!
//! Embree comes from Debian (`apt-get install libembree-dev`): `cargo bench -p corf-raytrace --features embree --bench embree [SCENE]`
//! (`scenes/lobby.glb` unless a glb file is named). Each repeat times every contender once, in turn, over all rays of a kind, so that
//! what else the machine does falls on all alike, and counts the time that the thread ran; rates are medians over the repeats and ratios medians of
//! the repeats' ratios. Embree runs twice, as it comes and with `RTC_SCENE_FLAG_ROBUST`, which is its watertight mode and the fair comparison.

#![allow(clippy::print_stdout, clippy::print_stderr)]

mod test_rays;

use corf_raytrace::{Bvh, Ray};
use corf_scene::Scene;
use std::hint::black_box;
use std::path::PathBuf;
use std::time::{Duration, Instant};

const REPEATS: usize = 15;
/// Two distances agree within this share of themselves: f32 rounding of two different triangle tests.
const T_TOLERANCE: f32 = 1e-4;
/// Largest absolute difference of two distances, metres: some ten roundings of a position at 15 m, the error of a hit right at the ray's
/// start.
const LENGTH_TOLERANCE: f32 = 1e-5;
/// Rays, at most, that may disagree: those that graze an edge, where Embree's default test is not watertight.
const DISAGREEING_SHARE: f64 = 2e-3;

/// Free rays end at this share of the way to what they would hit.
const FREE_SHARE: f32 = 0.999;

/// Bindings of the C library, after the Embree 3 API reference (`RTCRay`, `RTCHit`, `RTCIntersectContext` and the calls below).
mod ffi {
    use std::ffi::{c_char, c_int, c_uint, c_void};

    #[derive(Clone, Copy, Default)]
    #[repr(C, align(16))]
    pub struct Ray {
        pub origin: [f32; 3],
        pub near: f32,
        pub direction: [f32; 3],
        pub time: f32,
        pub far: f32,
        pub mask: c_uint,
        pub id: c_uint,
        pub flags: c_uint,
    }

    #[derive(Clone, Copy, Default)]
    #[repr(C, align(16))]
    pub struct Hit {
        pub normal: [f32; 3],
        pub u: f32,
        pub v: f32,
        pub primitive: c_uint,
        pub geometry: c_uint,
        pub instance: c_uint,
    }

    #[derive(Clone, Copy, Default)]
    #[repr(C, align(16))]
    pub struct RayHit {
        pub ray: Ray,
        pub hit: Hit,
    }

    #[repr(C)]
    pub struct Context {
        pub flags: c_int,
        pub filter: *const c_void,
        pub instance: c_uint,
    }

    pub type Handle = *mut c_void;
    pub const TRIANGLES: c_int = 0;
    pub const INDEX_BUFFER: c_int = 0;
    pub const VERTEX_BUFFER: c_int = 1;
    pub const UINT3: c_int = 0x5003;
    pub const FLOAT3: c_int = 0x9003;
    pub const ROBUST: c_int = 1 << 2;
    pub const INVALID: c_uint = c_uint::MAX;

    /// `struct timespec` of a 64-bit Linux.
    #[derive(Default)]
    #[repr(C)]
    pub struct Timespec {
        pub seconds: i64,
        pub nanoseconds: i64,
    }

    /// `CLOCK_THREAD_CPUTIME_ID` of Linux.
    pub const THREAD_TIME: c_int = 3;

    unsafe extern "C" {
        pub fn clock_gettime(clock: c_int, time: *mut Timespec) -> c_int;
    }

    #[link(name = "embree3")]
    unsafe extern "C" {
        pub fn rtcNewDevice(config: *const c_char) -> Handle;
        pub fn rtcGetDeviceError(device: Handle) -> c_int;
        pub fn rtcReleaseDevice(device: Handle);
        pub fn rtcNewScene(device: Handle) -> Handle;
        pub fn rtcSetSceneFlags(scene: Handle, flags: c_int);
        pub fn rtcCommitScene(scene: Handle);
        pub fn rtcReleaseScene(scene: Handle);
        pub fn rtcNewGeometry(device: Handle, kind: c_int) -> Handle;
        pub fn rtcSetNewGeometryBuffer(
            geometry: Handle,
            kind: c_int,
            slot: c_uint,
            format: c_int,
            stride: usize,
            count: usize,
        ) -> *mut c_void;
        pub fn rtcCommitGeometry(geometry: Handle);
        pub fn rtcAttachGeometry(scene: Handle, geometry: Handle) -> c_uint;
        pub fn rtcReleaseGeometry(geometry: Handle);
        pub fn rtcIntersect1(scene: Handle, context: *mut Context, ray: *mut RayHit);
        pub fn rtcOccluded1(scene: Handle, context: *mut Context, ray: *mut Ray);
    }
}

/// Embree's tree over a scene's triangles.
struct Embree {
    device: ffi::Handle,
    scene: ffi::Handle,
}

impl Embree {
    fn build(scene: &Scene, flags: std::ffi::c_int) -> Self {
        // SAFETY: the calls are those of the API reference in its order; both buffers are written in full before the commit, at the
        // sizes they were made with.
        unsafe {
            let device = ffi::rtcNewDevice(c"threads=1".as_ptr());
            assert!(!device.is_null(), "Embree gives no device: error {}", ffi::rtcGetDeviceError(device));
            let tree = ffi::rtcNewScene(device);
            ffi::rtcSetSceneFlags(tree, flags);
            let geometry = ffi::rtcNewGeometry(device, ffi::TRIANGLES);
            let (vertices, triangles) = (scene.positions.len(), scene.triangles.len());
            let to = ffi::rtcSetNewGeometryBuffer(geometry, ffi::VERTEX_BUFFER, 0, ffi::FLOAT3, 12, vertices).cast::<[f32; 3]>();
            let indices =
                ffi::rtcSetNewGeometryBuffer(geometry, ffi::INDEX_BUFFER, 0, ffi::UINT3, 12, triangles).cast::<[u32; 3]>();
            assert!(!to.is_null() && !indices.is_null(), "Embree gives no buffer: error {}", ffi::rtcGetDeviceError(device));
            for (i, p) in scene.positions.iter().enumerate() {
                to.add(i).write(p.to_array());
            }
            for (i, t) in scene.triangles.iter().enumerate() {
                indices.add(i).write(t.vertices);
            }
            ffi::rtcCommitGeometry(geometry);
            ffi::rtcAttachGeometry(tree, geometry);
            ffi::rtcReleaseGeometry(geometry);
            ffi::rtcCommitScene(tree);
            assert_eq!(ffi::rtcGetDeviceError(device), 0, "Embree builds no tree");
            Self { device, scene: tree }
        }
    }

    fn ray(ray: &Ray) -> ffi::Ray {
        ffi::Ray {
            origin: ray.origin.to_array(),
            near: ray.t_min,
            direction: ray.direction.to_array(),
            far: ray.t_max,
            mask: u32::MAX,
            ..ffi::Ray::default()
        }
    }

    fn context() -> ffi::Context {
        ffi::Context { flags: 0, filter: std::ptr::null(), instance: ffi::INVALID }
    }

    fn intersect(&self, ray: &Ray) -> Option<f32> {
        let mut rayhit = ffi::RayHit {
            ray: Self::ray(ray),
            hit: ffi::Hit { geometry: ffi::INVALID, instance: ffi::INVALID, ..ffi::Hit::default() },
        };
        // SAFETY: the scene is committed; context and ray are of the reference's layout and alignment and live through the call.
        unsafe { ffi::rtcIntersect1(self.scene, &mut Self::context(), &mut rayhit) };
        (rayhit.hit.geometry != ffi::INVALID).then_some(rayhit.ray.far)
    }

    fn occluded(&self, ray: &Ray) -> bool {
        let mut ray = Self::ray(ray);
        // SAFETY: as in `intersect`.
        unsafe { ffi::rtcOccluded1(self.scene, &mut Self::context(), &mut ray) };
        ray.far == f32::NEG_INFINITY
    }
}

impl Drop for Embree {
    fn drop(&mut self) {
        // SAFETY: both were made in `build` and are released once.
        unsafe {
            ffi::rtcReleaseScene(self.scene);
            ffi::rtcReleaseDevice(self.device);
        }
    }
}

/// Processor time of the calling thread so far.
fn thread_time() -> Duration {
    let mut time = ffi::Timespec::default();
    // SAFETY: the structure is the one that the call fills.
    let status = unsafe { ffi::clock_gettime(ffi::THREAD_TIME, &mut time) };
    assert_eq!(status, 0, "this system has no clock per thread");
    Duration::new(time.seconds as u64, time.nanoseconds as u32)
}

fn median(mut values: Vec<f64>) -> f64 {
    values.sort_by(f64::total_cmp);
    values[values.len() / 2]
}

/// Shoots rays and returns how many hit.
type Contender<'a> = &'a dyn Fn(&[Ray]) -> usize;

/// Times the three contenders in turn and prints their rates (Mrays/s) and corf's share of each of Embree's.
fn compare(name: &str, rays: &[Ray], contenders: [Contender<'_>; 3]) {
    let mut rates = [const { Vec::new() }; 3];
    for repeat in 0..=REPEATS {
        for (contender, rates) in contenders.iter().zip(&mut rates) {
            let start = thread_time();
            black_box(contender(black_box(rays)));
            // The first repeat warms the caches.
            if repeat > 0 {
                rates.push(rays.len() as f64 / (thread_time() - start).as_secs_f64() / 1e6);
            }
        }
    }
    let ratio = |other: usize| median(rates[0].iter().zip(&rates[other]).map(|(corf, embree)| corf / embree).collect());
    let (default, robust) = (ratio(1), ratio(2));
    let [corf, embree, watertight] = rates.map(median);
    println!("{name:<24} {corf:>7.2} {embree:>9.2} {watertight:>9.2}   {default:>9.2} {robust:>9.2}");
}

/// Counts the rays on which two answers differ and fails where they are more than grazing explains.
fn check(name: &str, differing: usize, of: usize) {
    println!("{name}: {differing} of {of} rays differ");
    assert!(differing as f64 <= DISAGREEING_SHARE * of as f64, "{name}: too many to be rays that graze edges");
}

fn main() {
    let named = std::env::args().skip(1).find(|a| !a.starts_with('-')).map(PathBuf::from);
    let path = named.unwrap_or_else(|| PathBuf::from(concat!(env!("CARGO_MANIFEST_DIR"), "/../../scenes/lobby.glb")));
    let scene = corf_scene::import::load(&path).unwrap_or_else(|e| panic!("{}: {e}", path.display()));
    let timed = |what: &str, seconds: f64| println!("build, {what}: {seconds:.3} s by the clock");
    let start = Instant::now();
    let bvh = Bvh::build(&scene);
    timed("corf, all threads", start.elapsed().as_secs_f64());
    let start = Instant::now();
    let [default, robust] = [Embree::build(&scene, 0), Embree::build(&scene, ffi::ROBUST)];
    timed("Embree, one thread, twice", start.elapsed().as_secs_f64());

    let [camera, bounce, shadow] = test_rays::rays(&scene, &bvh);
    // Rays that meet nothing before they end: all that lies along them has to be looked at.
    let free = bounce.iter().filter_map(|r| bvh.intersect(r).map(|hit| Ray { t_max: hit.t * FREE_SHARE, ..*r })).collect();
    let sets: [(&str, Vec<Ray>); 4] = [("camera", camera), ("bounce", bounce), ("free bounce", free), ("shadow", shadow)];
    println!("{} triangles, {} camera rays", scene.triangles.len(), sets[0].1.len());
    let agree = |ray: &Ray, a: Option<f32>, b: Option<f32>| match (a, b) {
        (Some(a), Some(b)) => (a - b).abs() <= T_TOLERANCE * a.abs().max(b.abs()) + LENGTH_TOLERANCE / ray.direction.length(),
        (a, b) => a.is_none() && b.is_none(),
    };
    for (mode, embree) in [("default", &default), ("robust", &robust)] {
        for (kind, rays) in &sets {
            let differ = |r: &&Ray| !agree(r, bvh.intersect(r).map(|h| h.t), embree.intersect(r));
            check(&format!("{kind}, closest, {mode}"), rays.iter().filter(differ).count(), rays.len());
            let differ = |r: &&Ray| bvh.occluded(r) != embree.occluded(r);
            check(&format!("{kind}, occlusion, {mode}"), rays.iter().filter(differ).count(), rays.len());
        }
    }

    println!("{:<24} {:>7} {:>9} {:>9}   {:>9} {:>9}", "Mrays/s, one core", "corf", "default", "robust", "/default", "/robust");
    for (kind, rays) in &sets {
        compare(
            &format!("{kind}, closest"),
            rays,
            [
                &|rays| rays.iter().filter(|r| bvh.intersect(r).is_some()).count(),
                &|rays| rays.iter().filter(|r| default.intersect(r).is_some()).count(),
                &|rays| rays.iter().filter(|r| robust.intersect(r).is_some()).count(),
            ],
        );
        compare(
            &format!("{kind}, occlusion"),
            rays,
            [
                &|rays| rays.iter().filter(|r| bvh.occluded(r)).count(),
                &|rays| rays.iter().filter(|r| default.occluded(r)).count(),
                &|rays| rays.iter().filter(|r| robust.occluded(r)).count(),
            ],
        );
    }
}
