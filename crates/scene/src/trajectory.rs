//! The platform's way: a closed, smooth loop through waypoints at constant speed.

use crate::words::{counted, verb};
use crate::{Error, Result, Rigid3, bounds};
use glam::{DVec2, DVec3};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use std::f64::consts::TAU;

/// `[trajectory]` of a scene file.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct TrajectoryConfig {
    /// Corners of the loop in plan, `[x, y]` in metres, at least 3; the curve passes through every one and closes by itself.
    pub waypoints_m: Vec<[f64; 2]>,
    /// Mean height of the camera and the array, metres. Default 1.6.
    #[serde(default = "default_height")]
    pub height_m: f64,
    /// Amplitude of the height's sinusoid, metres. Default 0.
    #[serde(default)]
    pub height_amplitude_m: f64,
    /// Amplitude of the pitch's sinusoid, degrees. Default 0.
    #[serde(default)]
    pub pitch_amplitude_deg: f64,
    /// Amplitude of the yaw's sinusoid about the way's heading, degrees. Default 0.
    #[serde(default)]
    pub yaw_amplitude_deg: f64,
    /// Speed along the way, m/s. Default 0.5.
    #[serde(default = "default_speed")]
    pub speed_m_per_s: f64,
}

fn default_height() -> f64 {
    1.6
}
fn default_speed() -> f64 {
    0.5
}

/// One pose of the platform.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TrajectoryPose {
    /// Index along the trajectory, from 0.
    pub index: usize,
    /// Time, seconds, from 0.
    pub time_s: f64,
    /// Pose of the camera (OpenCV axes).
    pub world_from_camera: Rigid3,
}

/// Way travelled in one period of the height's sinusoid, metres. The three periods stand as 1 : √2 : √3, so no pair repeats together.
const HEIGHT_PERIOD_M: f64 = 7.0;
/// Way travelled in one period of the pitch's sinusoid, metres.
const PITCH_PERIOD_M: f64 = 7.0 * std::f64::consts::SQRT_2;
/// Way travelled in one period of the yaw's sinusoid, metres.
const YAW_PERIOD_M: f64 = 7.0 * 1.732_050_807_568_877_2;
/// The heading is the chord from this far behind to this far ahead, metres: it turns smoothly where the curve's curvature jumps.
const HEADING_CHORD_M: f64 = 0.25;
/// No part of the way ends later, loops: beyond it, poses would be rounded.
const MAX_LOOPS: f64 = 1000.0;
/// Two waypoints nearer than this are one, metres.
const SMALLEST_LEG_M: f64 = 1e-3;

impl TrajectoryConfig {
    /// Checks every value; `place` names the table in messages.
    ///
    /// # Errors
    /// The first value out of range.
    pub fn validate(&self, place: &str) -> Result<()> {
        let n = self.waypoints_m.len();
        if n < 3 {
            return Err(Error::invalid(
                format!("{place}.waypoints_m"),
                format!("{} {} no loop", counted(n, "waypoint"), verb(n, "makes", "make")),
                "give at least 3 [x, y] pairs in metres",
            ));
        }
        for i in 0..n {
            let (a, b) = (DVec2::from_array(self.waypoints_m[i]), DVec2::from_array(self.waypoints_m[(i + 1) % n]));
            bounds::position(&format!("{place}.waypoints_m[{i}]"), a.extend(0.0))?;
            if a.distance(b) < SMALLEST_LEG_M {
                return Err(Error::invalid(
                    format!("{place}.waypoints_m[{i}]"),
                    "the next waypoint is the same point",
                    "drop one of them; the loop closes without repeating its first point",
                ));
            }
        }
        for (key, value, low, high) in [
            ("height_m", self.height_m, -1e3, 1e3),
            ("height_amplitude_m", self.height_amplitude_m, 0.0, 1e3),
            ("pitch_amplitude_deg", self.pitch_amplitude_deg, 0.0, 85.0),
            ("yaw_amplitude_deg", self.yaw_amplitude_deg, 0.0, 180.0),
            ("speed_m_per_s", self.speed_m_per_s, 1e-6, 1e3),
        ] {
            if !(low..=high).contains(&value) {
                return Err(Error::invalid(
                    format!("{place}.{key}"),
                    format!("{value} is out of range"),
                    format!("give a value from {low} to {high}"),
                ));
            }
        }
        Ok(())
    }
}

/// A closed centripetal Catmull–Rom curve in plan, as one cubic Hermite segment a leg.
struct Loop {
    /// Per leg: start, end, and the tangents (with respect to the leg's own parameter in `[0, 1]`) there.
    legs: Vec<[DVec2; 4]>,
    /// Arc length at the start of every subdivision, `SUBDIVISIONS` a leg, and the total at the end.
    lengths: Vec<f64>,
}

/// Subdivisions of a leg in the arc-length table; Newton's method refines between them.
const SUBDIVISIONS: usize = 64;

impl Loop {
    fn through(points: &[DVec2]) -> Self {
        let n = points.len();
        let at = |i: usize| points[i % n];
        // Centripetal knots: t_{i+1} − t_i = |P_{i+1} − P_i|^{1/2} (Yuksel et al. 2011): no cusps, no self-crossing within a leg.
        let knot = |i: usize| at(i).distance(at(i + 1)).sqrt();
        let slope = |i: usize| {
            // Derivative at P_i of the non-uniform Catmull–Rom curve (Barry & Goldman 1988).
            let (before, after) = (knot(i + n - 1), knot(i));
            let (p0, p1, p2) = (at(i + n - 1), at(i), at(i + 1));
            (p1 - p0) / before - (p2 - p0) / (before + after) + (p2 - p1) / after
        };
        let legs: Vec<[DVec2; 4]> = (0..n).map(|i| [at(i), at(i + 1), slope(i) * knot(i), slope(i + 1) * knot(i)]).collect();
        let mut curve = Self { legs, lengths: vec![0.0] };
        let h = 1.0 / SUBDIVISIONS as f64;
        let mut total = 0.0;
        for i in 0..n * SUBDIVISIONS {
            let (leg, t) = (i / SUBDIVISIONS, (i % SUBDIVISIONS) as f64 * h);
            total += curve.arc(leg, t, t + h);
            curve.lengths.push(total);
        }
        curve
    }

    fn length(&self) -> f64 {
        self.lengths[self.lengths.len() - 1]
    }

    fn position(&self, leg: usize, t: f64) -> DVec2 {
        let [p0, p1, m0, m1] = self.legs[leg];
        let (t2, t3) = (t * t, t * t * t);
        p0 * (2.0 * t3 - 3.0 * t2 + 1.0) + m0 * (t3 - 2.0 * t2 + t) + p1 * (3.0 * t2 - 2.0 * t3) + m1 * (t3 - t2)
    }

    fn speed(&self, leg: usize, t: f64) -> f64 {
        let [p0, p1, m0, m1] = self.legs[leg];
        let t2 = t * t;
        ((p1 - p0) * (6.0 * (t - t2)) + m0 * (3.0 * t2 - 4.0 * t + 1.0) + m1 * (3.0 * t2 - 2.0 * t)).length()
    }

    /// Arc length of leg parameters `[a, b]` by five-point Gauss–Legendre quadrature.
    fn arc(&self, leg: usize, a: f64, b: f64) -> f64 {
        const NODES: [(f64, f64); 5] = [
            (0.0, 0.568_888_888_888_888_9),
            (0.538_469_310_105_683_1, 0.478_628_670_499_366_47),
            (-0.538_469_310_105_683_1, 0.478_628_670_499_366_47),
            (0.906_179_845_938_664, 0.236_926_885_056_189_1),
            (-0.906_179_845_938_664, 0.236_926_885_056_189_1),
        ];
        let (middle, half) = (0.5 * (a + b), 0.5 * (b - a));
        half * NODES.iter().map(|(x, w)| w * self.speed(leg, middle + half * x)).sum::<f64>()
    }

    /// The point `s` metres along the loop (any real number; the loop repeats).
    fn at_length(&self, s: f64) -> DVec2 {
        let s = s.rem_euclid(self.length());
        let i = self.lengths.partition_point(|l| *l <= s).clamp(1, self.lengths.len() - 1) - 1;
        let (leg, start) = (i / SUBDIVISIONS, (i % SUBDIVISIONS) as f64 / SUBDIVISIONS as f64);
        let rest = s - self.lengths[i];
        let mut t = start + rest / (self.lengths[i + 1] - self.lengths[i]) / SUBDIVISIONS as f64;
        for _ in 0..3 {
            t -= (self.arc(leg, start, t) - rest) / self.speed(leg, t).max(1e-9);
        }
        self.position(leg, t)
    }
}

/// Way around the loop of `config`, metres.
///
/// # Errors
/// As [`TrajectoryConfig::validate`].
pub fn loop_length_m(config: &TrajectoryConfig) -> Result<f64> {
    config.validate("trajectory")?;
    Ok(curve(config).length())
}

/// `count` poses equally spaced along the loop, once around, at constant speed in plan.
///
/// # Errors
/// As [`TrajectoryConfig::validate`], or `count == 0`.
pub fn generate(config: &TrajectoryConfig, count: usize) -> Result<Vec<TrajectoryPose>> {
    generate_between(config, count, [0.0, 1.0])
}

/// Poses of a part of the loop, otherwise as [`generate`]: `way` is where it starts and where it ends, in loops (`[0.75, 1.25]` crosses the first
/// waypoint). The last pose stands one step before the end, so that a whole loop meets its first pose again.
///
/// # Errors
/// As [`generate`], or a part that is empty, runs backwards or is longer than one loop.
pub fn generate_between(config: &TrajectoryConfig, count: usize, way: [f64; 2]) -> Result<Vec<TrajectoryPose>> {
    config.validate("trajectory")?;
    if count == 0 {
        return Err(Error::invalid("keyframes", "a trajectory of no poses", "ask for at least one"));
    }
    bounds::count("trajectory", count, bounds::MAX_LINKS, "poses")?;
    let [start, end] = way;
    if !(start >= 0.0 && end > start && end - start <= 1.0 && end <= MAX_LOOPS) {
        let help = "give [start, end] in loops, at most one and in the first thousand, e.g. [0.0, 1.0] for a whole one";
        return Err(Error::invalid("way", format!("[{start}, {end}] is no part of a loop"), help));
    }
    let curve = curve(config);
    let step = (end - start) * curve.length() / count as f64;
    let first = start * curve.length();
    Ok((0..count)
        .map(|index| {
            let travelled = index as f64 * step;
            TrajectoryPose { time_s: travelled / config.speed_m_per_s, ..pose(config, &curve, index, first + travelled) }
        })
        .collect())
}

fn curve(config: &TrajectoryConfig) -> Loop {
    let points: Vec<DVec2> = config.waypoints_m.iter().map(|p| DVec2::from_array(*p)).collect();
    Loop::through(&points)
}

/// The pose `s` metres along the way.
fn pose(config: &TrajectoryConfig, curve: &Loop, index: usize, s: f64) -> TrajectoryPose {
    let plan = curve.at_length(s);
    let chord = curve.at_length(s + HEADING_CHORD_M) - curve.at_length(s - HEADING_CHORD_M);
    let yaw = chord.y.atan2(chord.x) + config.yaw_amplitude_deg.to_radians() * (TAU * s / YAW_PERIOD_M).sin();
    let pitch = config.pitch_amplitude_deg.to_radians() * (TAU * s / PITCH_PERIOD_M).sin();
    let eye = plan.extend(config.height_m + config.height_amplitude_m * (TAU * s / HEIGHT_PERIOD_M).sin());
    let forward = DVec3::new(yaw.cos() * pitch.cos(), yaw.sin() * pitch.cos(), pitch.sin());
    TrajectoryPose {
        index,
        time_s: s / config.speed_m_per_s,
        world_from_camera: Rigid3::looking_at(eye, eye + forward, DVec3::Z),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn config() -> TrajectoryConfig {
        TrajectoryConfig {
            waypoints_m: vec![[2.0, 2.0], [12.0, 2.5], [12.0, 6.0], [6.5, 7.0], [5.5, 13.0], [2.0, 12.5]],
            height_m: 1.6,
            height_amplitude_m: 0.1,
            pitch_amplitude_deg: 6.0,
            yaw_amplitude_deg: 20.0,
            speed_m_per_s: 0.5,
        }
    }

    #[test]
    fn a_part_of_the_way_is_the_same_way() {
        let c = config();
        let (whole, part) = (generate(&c, 40).unwrap(), generate_between(&c, 20, [0.5, 1.0]).unwrap());
        for (a, b) in whole[20..].iter().zip(&part) {
            assert!((a.world_from_camera.translation - b.world_from_camera.translation).length() < 1e-9);
        }
        assert_eq!(part[0].time_s, 0.0);
        for wrong in [[0.5, 0.5], [0.5, 0.2], [-0.1, 0.5], [0.0, 1.1], [f64::NAN, 1.0]] {
            assert!(generate_between(&c, 20, wrong).is_err());
        }
    }

    #[test]
    fn poses_are_equally_spaced_in_way_and_time() {
        let c = config();
        let poses = generate(&c, 147).unwrap();
        let length = loop_length_m(&c).unwrap();
        // The arc-length table against a polyline of the same curve, 200 000 chords.
        let curve = curve(&c);
        let n = 200_000;
        let at = |i: usize| curve.at_length(length * (i % n) as f64 / n as f64);
        let polyline: f64 = (0..n).map(|i| at(i).distance(at(i + 1))).sum();
        assert!((polyline - length).abs() < 1e-6 * length, "{polyline} {length}");
        let chord = length / n as f64;
        assert!((0..n).all(|i| (at(i).distance(at(i + 1)) - chord).abs() < 1e-4 * chord));
        for pair in poses.windows(2) {
            assert!((pair[1].time_s - pair[0].time_s - length / 147.0 / 0.5).abs() < 1e-9);
        }
    }

    #[test]
    fn the_curve_passes_every_waypoint_and_closes() {
        let c = config();
        let curve = curve(&c);
        for (i, w) in c.waypoints_m.iter().enumerate() {
            let s = curve.lengths[i * SUBDIVISIONS];
            assert!(curve.at_length(s).distance(DVec2::from_array(*w)) < 1e-9);
        }
        assert!(curve.at_length(curve.length() - 1e-9).distance(curve.at_length(0.0)) < 1e-8);
    }

    #[test]
    fn position_and_orientation_have_continuous_first_derivatives() {
        // Halving the step of a C1 function about any point halves the jump between one-sided difference quotients (curvature
        // bounded); a kink would leave it as it is.
        let c = config();
        let curve = curve(&c);
        let jump = |h: f64| {
            let n = 4000;
            let step = curve.length() / n as f64;
            (0..n)
                .map(|i| {
                    let s = i as f64 * step + curve.lengths[SUBDIVISIONS] % step;
                    let [a, b, d] = [s - h, s, s + h].map(|s| pose(&c, &curve, 0, s).world_from_camera);
                    let position = ((d.translation - b.translation) - (b.translation - a.translation)).length() / h;
                    let turned = (d.rotation - b.rotation) - (b.rotation - a.rotation);
                    position.max(turned.to_cols_array().iter().fold(0.0_f64, |m, v| m.max(v.abs())) / h)
                })
                .fold(0.0, f64::max)
        };
        let (coarse, fine) = (jump(2e-3), jump(1e-3));
        assert!(fine < 0.6 * coarse, "{fine} {coarse}");
    }

    #[test]
    fn poses_are_rigid_and_level() {
        for p in generate(&config(), 40).unwrap() {
            Rigid3::from_rows(&p.world_from_camera.to_rows(), "test").unwrap();
            // No roll: the camera's x axis is horizontal; its y axis points down.
            assert!(p.world_from_camera.rotation.x_axis.z.abs() < 1e-12);
            assert!(p.world_from_camera.rotation.y_axis.z < -0.9);
        }
    }

    #[test]
    fn bad_waypoints_are_named() {
        let mut c = config();
        c.waypoints_m[3] = c.waypoints_m[2];
        assert!(generate(&c, 4).unwrap_err().to_string().contains("waypoints_m[2]"));
        c.waypoints_m[1][0] = f64::NAN;
        assert!(generate(&c, 4).unwrap_err().to_string().contains("waypoints_m[1]"));
        c.waypoints_m.truncate(2);
        assert!(generate(&c, 4).is_err());
        assert!(generate(&config(), 0).is_err());
    }
}
