use super::*;
use crate::builder::checks::{self, committed};
use crate::builder::materials::Mat;
use crate::config::SceneConfig;
use crate::{Scene, import, trajectory};
use glam::DVec3;

fn loaded() -> Scene {
    import::load(committed("lobby.glb")).unwrap()
}

/// Name prefix of objects beyond the glass, which are no part of the room.
const OUTSIDE: &str = "Outdoor";

#[test]
fn the_committed_file_is_what_the_builder_writes_again_on_one_thread() {
    checks::assert_committed("lobby", build);
}

#[test]
fn the_file_is_small_and_rich() {
    // Small enough to clone with the source.
    assert!(std::fs::metadata(committed("lobby.glb")).unwrap().len() < 12_000_000);
    checks::assert_rich(&loaded());
}

#[test]
fn every_material_has_a_radio_slab_valid_at_60_ghz() {
    let ids = checks::assert_radio(&loaded());
    for id in [
        "concrete",
        "plasterboard",
        "glass",
        "wood",
        "marble",
        "metal",
        "leather",
        "cloth",
        "plastic",
        "ceiling_board",
        "chipboard",
        "floorboard",
    ] {
        assert!(ids.contains(id), "{id} is missing");
    }
}

#[test]
fn the_room_is_14_by_15_by_3_and_a_half_metres_and_l_shaped() {
    let scene = loaded();
    let (mut low, mut high) = (DVec3::MAX, DVec3::MIN);
    for (i, t) in scene.triangles.iter().enumerate() {
        if scene.objects[t.object as usize].name.starts_with(OUTSIDE) {
            continue;
        }
        for p in scene.corners_f64(i) {
            low = low.min(p);
            high = high.max(p);
            // Door leaves and mullions stand in their wall's opening, at most 6 cm behind its face.
            assert!(
                p.x < 8.57 || p.y < 9.07,
                "{:?} reaches into the cut-out corner at {p}",
                scene.objects[t.object as usize].name
            );
        }
    }
    // Frames in openings reach 6 cm behind the wall's face.
    const REVEAL_M: f64 = 0.061;
    assert!(low.z.abs() < 1e-9 && high.z == 3.5, "{low} {high}");
    assert!(
        low.abs().max_element() < REVEAL_M && (high - DVec3::new(14.0, 15.0, 3.5)).abs().max_element() < REVEAL_M,
        "{low} {high}"
    );
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
        FloorTiles | FloorBoards | Ceiling | Plaster | PlasterTeal | PlasterSand | Concrete | ConcreteBacking | MarbleGreen | Glass | DoorGlass
            | Leaf | LeafPale | Street | LightPanel | UpLight | Downlight | PendantGlow | LampShade | ScreenWelcome | ScreenSchedule | ScreenDesk | LiftSign
            | Exit | ClockFace | PosterExpo | PosterWaves | PosterChart | PosterMap | PosterGrid | PosterHills
            // Trim laid on a closed body: pillar rings, labels, the belt, the pendants' two-sided shades.
            | Brushed | WhiteMetal | WhitePlastic | BlackPlastic | ClothRust | DarkMetal | Brass
    )
}

#[test]
fn closed_things_are_closed_and_wound_outwards() {
    let (closed, open) = checks::assert_closed(&objects(), is_sheet);
    assert!(closed > 1000 && open > 500, "{closed} closed, {open} open");
}

#[test]
fn nothing_is_doubled_and_no_body_has_a_hole() {
    checks::assert_sound(&loaded());
}

#[test]
fn the_platform_keeps_40_cm_from_everything_up_to_2_m() {
    let config = SceneConfig::load(committed("lobby.toml")).unwrap();
    let poses = trajectory::generate(config.trajectory.as_ref().unwrap(), 500).unwrap();
    checks::assert_clearance(&loaded(), &poses, 0.4);
    // Both arms are visited, and the transmitter stands where it should.
    assert!(
        poses.iter().any(|p| p.world_from_camera.translation.y > 12.5)
            && poses.iter().any(|p| p.world_from_camera.translation.x > 9.5)
    );
    assert_eq!(config.transmitter.position_m, [12.4, 4.5, 2.0]);
}
