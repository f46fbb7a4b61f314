use super::*;
use crate::builder::checks::{self, committed};
use crate::builder::materials::Mat;
use crate::config::SceneConfig;
use crate::{Scene, import, trajectory};
use glam::DVec3;

fn loaded() -> Scene {
    import::load(committed("office.glb")).unwrap()
}

#[test]
fn the_committed_file_is_what_the_builder_writes_again_on_one_thread() {
    checks::assert_committed("office", build);
}

#[test]
fn the_file_is_small_and_rich() {
    assert!(std::fs::metadata(committed("office.glb")).unwrap().len() < 8_000_000);
    checks::assert_rich(&loaded());
}

#[test]
fn every_material_has_a_radio_slab_valid_at_60_ghz() {
    let ids = checks::assert_radio(&loaded());
    for id in ["concrete", "plasterboard", "glass", "wood", "metal", "cloth", "plastic", "ceiling_board", "chipboard"] {
        assert!(ids.contains(id), "{id} is missing");
    }
}

#[test]
fn the_floor_is_18_by_12_by_2_point_8_metres() {
    /// Bars of the outer windows reach this far behind their wall's face.
    const REVEAL_M: f64 = 0.041;
    let scene = loaded();
    let (mut low, mut high) = (DVec3::MAX, DVec3::MIN);
    for (i, t) in scene.triangles.iter().enumerate() {
        // What lies beyond the glass is no part of the floor.
        if !scene.objects[t.object as usize].name.starts_with("Outdoor") {
            for p in scene.corners_f64(i) {
                (low, high) = (low.min(p), high.max(p));
            }
        }
    }
    assert!(low.z.abs() < 1e-6 && (high.z - plan::HEIGHT).abs() < 1e-6, "{low} {high}");
    let size = DVec3::new(plan::SIZE[0], plan::SIZE[1], plan::HEIGHT);
    assert!(low.abs().max_element() < REVEAL_M && (high - size).abs().max_element() < REVEAL_M, "{low} {high}");
}

#[test]
fn normals_are_unit_and_agree_with_the_winding() {
    checks::assert_normals(&objects());
}

/// Materials of which single sheets are made.
fn is_sheet(mat: Mat) -> bool {
    use Mat::*;
    matches!(
        mat,
        CarpetTiles | CarpetTilesWarm | Vinyl | FloorBoards | Ceiling | PaintedConcrete | Glass | DoorGlass | Film | Street | LightPanel
            | Leaf | LeafPale | ScreenWelcome | ScreenSchedule | ScreenDesk | ScreenCode | Exit | ClockFace
            // Trim laid on a closed body: the bands of bins and the extinguisher's label.
            | BlackPlastic | WhitePlastic
    )
}

#[test]
fn closed_things_are_closed_and_wound_outwards() {
    let (closed, open) = checks::assert_closed(&objects(), is_sheet);
    assert!(closed > 1000 && open > 300, "{closed} closed, {open} open");
}

#[test]
fn nothing_is_doubled_and_no_body_has_a_hole() {
    checks::assert_sound(&loaded());
}

#[test]
fn the_platform_keeps_30_cm_from_everything_up_to_2_m() {
    let config = SceneConfig::load(committed("office.toml")).unwrap();
    let poses = trajectory::generate(config.trajectory.as_ref().unwrap(), 500).unwrap();
    checks::assert_clearance(&loaded(), &poses, 0.3);
    // It goes through the office and round the bend, which the transmitter sees.
    let visits = |x: [f64; 2], y: [f64; 2]| {
        poses.iter().map(|p| p.world_from_camera.translation).any(|p| x[0] < p.x && p.x < x[1] && y[0] < p.y && p.y < y[1])
    };
    assert!(visits([5.0, 9.0], [0.9, 2.0]) && visits([11.5, 12.5], [3.0, 5.0]) && visits([4.0, 6.0], [6.2, 6.8]));
}
