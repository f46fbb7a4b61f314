//! The materials of rooms built in code: what light sees, and the slab 60 GHz sees.
//!
//! Permittivities are ITU-R P.2040-3 rows where there is one; plastic, leather and cloth carry the relative permittivity used in published
//! work on this kind of room, with a conductivity for a loss tangent of 0.01, 0.05 and 0.03 (an assumption: no 60 GHz table gives them).
//! Scattering coefficients and directive exponents are that work's too; floorboard takes chipboard's.

use super::textures::Tex;

/// Radio material of a surface.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum SurfaceRadio {
    /// A row of ITU-R P.2040-3 by its own name.
    Itu(&'static str),
    /// A name, the relative permittivity and the loss tangent at 60 GHz.
    Given(&'static str, f64, f64),
}

use SurfaceRadio::{Given, Itu};

const CONCRETE: SurfaceRadio = Itu("concrete");
const PLASTERBOARD: SurfaceRadio = Itu("plasterboard");
const GLASS: SurfaceRadio = Itu("glass");
const WOOD: SurfaceRadio = Itu("wood");
const MARBLE: SurfaceRadio = Itu("marble");
const METAL: SurfaceRadio = Itu("metal");
const CEILING: SurfaceRadio = Itu("ceiling_board");
const CHIPBOARD: SurfaceRadio = Itu("chipboard");
const FLOORBOARD: SurfaceRadio = Itu("floorboard");
const LEATHER: SurfaceRadio = Given("leather", 1.8, 0.05);
const CLOTH: SurfaceRadio = Given("cloth", 1.8, 0.03);
const PLASTIC: SurfaceRadio = Given("plastic", 2.3, 0.01);
/// A clipped hedge or a street far away: next to nothing comes back.
const FOLIAGE: SurfaceRadio = Given("foliage", 1.1, 0.1);

impl SurfaceRadio {
    /// The identifier in reports.
    pub fn id(self) -> &'static str {
        match self {
            Itu(id) | Given(id, ..) => id,
        }
    }

    /// Scattering coefficient S and directive exponent α_r.
    pub fn scattering(self) -> (f64, u32) {
        match self.id() {
            "plastic" => (0.2, 6),
            "leather" => (0.4, 3),
            "cloth" | "wood" | "foliage" => (0.8, 3),
            "metal" | "glass" => (0.1, 10),
            "marble" => (0.2, 10),
            _ => (0.4, 5),
        }
    }
}

/// One material.
#[derive(Clone, Copy, Debug)]
pub struct MaterialSpec {
    /// Name in the file.
    pub name: &'static str,
    /// Radio behaviour.
    pub radio: SurfaceRadio,
    /// Thickness of the slab, metres.
    pub thickness_m: f64,
    /// Linear base colour, multiplied with the texture.
    pub base: [f32; 3],
    /// Base colour texture; the emissive texture instead where `emissive` is not black.
    pub texture: Option<Tex>,
    /// Normal texture.
    pub normal: Option<Tex>,
    /// Size of one repetition of the textures, metres; `[1, 1]` where the mesh carries picture coordinates.
    pub texture_size_m: [f64; 2],
    /// 0 or 1.
    pub metallic: f32,
    /// Perceptual roughness.
    pub roughness: f32,
    /// Linear radiance.
    pub emissive: [f32; 3],
    /// Share of light let through (glass).
    pub transmission: f32,
}

const DEFAULT: MaterialSpec = MaterialSpec {
    name: "",
    radio: PLASTIC,
    thickness_m: 0.003,
    base: [0.8; 3],
    texture: None,
    normal: None,
    texture_size_m: [1.0, 1.0],
    metallic: 0.0,
    roughness: 0.6,
    emissive: [0.0; 3],
    transmission: 0.0,
};

/// Radiance of the ceiling panels: with the room's 14 of them and the suspended lights a mid-grey wall shows about 0.4 at exposure 0.
const PANEL: f32 = 20.0;
/// Radiance of the street's whitest texel.
const DAYLIGHT: f32 = 2.0;

macro_rules! materials {
    ($($variant:ident $name:literal $radio:ident $thickness:literal { $($field:ident : $value:expr),* $(,)? })*) => {
        /// A material.
        #[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
        #[allow(missing_docs)]
        pub enum Mat { $($variant),* }

        impl Mat {
            /// What light and radio see of it, its thickness and its name.
            pub fn spec(self) -> MaterialSpec {
                match self {
                    $(Mat::$variant => MaterialSpec {
                        name: $name, radio: $radio, thickness_m: $thickness, $($field: $value,)* ..DEFAULT
                    }),*
                }
            }
        }
    };
}

materials! {
    FloorTiles "Floor tiles" MARBLE 0.02 { base: [0.92; 3], texture: Some(Tex::FloorTiles), normal: Some(Tex::FloorTilesNormal), texture_size_m: [2.4, 2.4], roughness: 0.28 }
    FloorBoards "Floor boards" FLOORBOARD 0.02 { texture: Some(Tex::FloorBoards), texture_size_m: [1.6, 1.6], base: [0.95; 3], roughness: 0.38 }
    Rug "Rug" CLOTH 0.012 { texture: Some(Tex::Rug), base: [0.95; 3], roughness: 1.0 }
    RibbedCloth "Entrance mat" CLOTH 0.01 { texture: Some(Tex::Mat), base: [0.9; 3], texture_size_m: [0.32, 0.32], roughness: 1.0 }
    Plaster "Painted plaster" PLASTERBOARD 0.0125 { texture: Some(Tex::Plaster), base: [0.93, 0.92, 0.9], texture_size_m: [1.5, 1.5], roughness: 0.9 }
    PlasterTeal "Teal plaster" PLASTERBOARD 0.0125 { texture: Some(Tex::Plaster), base: [0.055, 0.18, 0.2], texture_size_m: [1.5, 1.5], roughness: 0.85 }
    PlasterSand "Sand plaster" PLASTERBOARD 0.0125 { texture: Some(Tex::Plaster), base: [0.76, 0.62, 0.46], texture_size_m: [1.5, 1.5], roughness: 0.9 }
    Concrete "Fair-faced concrete" CONCRETE 0.2 { texture: Some(Tex::Concrete), base: [1.0; 3], texture_size_m: [2.4, 2.4], roughness: 0.85 }
    ConcreteBacking "Concrete behind the lining" CONCRETE 0.2 { base: [0.35; 3], roughness: 0.9 }
    ConcretePot "Concrete planter" CONCRETE 0.03 { texture: Some(Tex::Terrazzo), base: [0.95; 3], texture_size_m: [0.7, 0.7], roughness: 0.5 }
    Clay "Glazed clay" CONCRETE 0.015 { base: [0.42, 0.13, 0.06], roughness: 0.35 }
    Ceiling "Ceiling boards" CEILING 0.02 { texture: Some(Tex::Ceiling), base: [1.0; 3], texture_size_m: [1.2, 1.2], roughness: 0.95 }
    MarbleWhite "White marble" MARBLE 0.03 { texture: Some(Tex::MarbleWhite), base: [0.95; 3], texture_size_m: [1.3, 1.3], roughness: 0.16 }
    MarbleGreen "Green marble" MARBLE 0.03 { texture: Some(Tex::MarbleGreen), base: [1.0; 3], texture_size_m: [0.9, 0.9], roughness: 0.14 }
    Oak "Oak" WOOD 0.02 { texture: Some(Tex::Oak), normal: Some(Tex::OakNormal), base: [0.95; 3], texture_size_m: [1.1, 1.1], roughness: 0.45 }
    Walnut "Walnut" WOOD 0.02 { texture: Some(Tex::Walnut), normal: Some(Tex::OakNormal), base: [1.0; 3], texture_size_m: [1.1, 1.1], roughness: 0.4 }
    DoorWood "Door leaf" WOOD 0.04 { texture: Some(Tex::Walnut), base: [1.0, 0.9, 0.8], texture_size_m: [1.3, 1.3], roughness: 0.4 }
    WhiteWood "White-lacquered wood" WOOD 0.016 { base: [0.84, 0.84, 0.82], roughness: 0.35 }
    Laminate "White laminate" CHIPBOARD 0.019 { base: [0.82, 0.82, 0.8], roughness: 0.4 }
    Shelf "Oak-faced chipboard" CHIPBOARD 0.019 { texture: Some(Tex::Oak), base: [0.8, 0.76, 0.72], texture_size_m: [1.1, 1.1], roughness: 0.5 }
    Felt "Black felt" CLOTH 0.01 { texture: Some(Tex::Weave), base: [0.03, 0.03, 0.033], texture_size_m: [0.2, 0.2], roughness: 1.0 }
    Cork "Notice board" CHIPBOARD 0.012 { texture: Some(Tex::Notices), base: [0.95; 3], roughness: 0.9 }
    Glass "Window glass" GLASS 0.008 { base: [0.95, 0.98, 0.97], roughness: 0.0, transmission: 1.0 }
    DoorGlass "Door glass" GLASS 0.012 { base: [0.94, 0.98, 0.96], roughness: 0.0, transmission: 1.0 }
    Brushed "Brushed steel" METAL 0.002 { texture: Some(Tex::Brushed), base: [0.78, 0.79, 0.8], texture_size_m: [0.6, 0.6], metallic: 1.0, roughness: 0.32 }
    Chrome "Polished steel" METAL 0.002 { base: [0.8, 0.8, 0.81], metallic: 1.0, roughness: 0.14 }
    Brass "Brass" METAL 0.002 { base: [0.88, 0.62, 0.28], metallic: 1.0, roughness: 0.24 }
    DarkMetal "Anthracite metal" METAL 0.002 { base: [0.045, 0.048, 0.052], roughness: 0.42 }
    WhiteMetal "White metal" METAL 0.0015 { base: [0.82, 0.83, 0.83], roughness: 0.38 }
    RedMetal "Red metal" METAL 0.002 { base: [0.62, 0.02, 0.018], roughness: 0.25 }
    GreyMetal "Grey cabinet" METAL 0.0012 { base: [0.42, 0.44, 0.46], roughness: 0.5 }
    Stud "Galvanised stud" METAL 0.001 { base: [0.6, 0.62, 0.64], metallic: 1.0, roughness: 0.4 }
    Vending "Vending machine front" METAL 0.002 { texture: Some(Tex::Vending), base: [0.95; 3], roughness: 0.3 }
    LeatherTan "Tan leather" LEATHER 0.004 { texture: Some(Tex::Leather), normal: Some(Tex::LeatherNormal), base: [0.5, 0.2, 0.075], texture_size_m: [0.4, 0.4], roughness: 0.45 }
    LeatherBlack "Black leather" LEATHER 0.004 { texture: Some(Tex::Leather), normal: Some(Tex::LeatherNormal), base: [0.04, 0.038, 0.036], texture_size_m: [0.4, 0.4], roughness: 0.4 }
    ClothTeal "Teal cloth" CLOTH 0.006 { texture: Some(Tex::Weave), normal: Some(Tex::WeaveNormal), base: [0.04, 0.28, 0.3], texture_size_m: [0.3, 0.3], roughness: 1.0 }
    ClothGrey "Grey cloth" CLOTH 0.006 { texture: Some(Tex::Weave), normal: Some(Tex::WeaveNormal), base: [0.42, 0.42, 0.43], texture_size_m: [0.3, 0.3], roughness: 1.0 }
    ClothMustard "Mustard cloth" CLOTH 0.006 { texture: Some(Tex::Weave), normal: Some(Tex::WeaveNormal), base: [0.78, 0.42, 0.06], texture_size_m: [0.3, 0.3], roughness: 1.0 }
    ClothRust "Rust cloth" CLOTH 0.006 { texture: Some(Tex::Weave), normal: Some(Tex::WeaveNormal), base: [0.55, 0.13, 0.06], texture_size_m: [0.3, 0.3], roughness: 1.0 }
    BlackPlastic "Black plastic" PLASTIC 0.003 { base: [0.025, 0.026, 0.028], roughness: 0.4 }
    WhitePlastic "White plastic" PLASTIC 0.003 { base: [0.82, 0.82, 0.8], roughness: 0.35 }
    BluePlastic "Blue plastic" PLASTIC 0.003 { base: [0.02, 0.12, 0.42], roughness: 0.35 }
    GreenPlastic "Green plastic" PLASTIC 0.003 { base: [0.03, 0.3, 0.1], roughness: 0.35 }
    Water "Bottled water" PLASTIC 0.002 { base: [0.35, 0.6, 0.75], roughness: 0.1 }
    Soil "Soil" CHIPBOARD 0.03 { texture: Some(Tex::Soil), texture_size_m: [0.15, 0.15], roughness: 1.0 }
    Leaf "Artificial leaves" PLASTIC 0.0005 { texture: Some(Tex::Leaf), base: [0.9; 3], roughness: 0.5 }
    LeafPale "Pale artificial leaves" PLASTIC 0.0005 { texture: Some(Tex::Leaf), base: [1.0, 0.98, 0.5], roughness: 0.5 }
    Books "Books" WOOD 0.025 { texture: Some(Tex::Books), base: [0.95; 3], roughness: 0.7 }
    Paper "Paper" WOOD 0.025 { base: [0.8, 0.77, 0.68], roughness: 0.95 }
    Keyboard "Keyboard" PLASTIC 0.003 { texture: Some(Tex::Keyboard), roughness: 0.5 }
    ClockFace "Clock face" PLASTIC 0.003 { texture: Some(Tex::Clock), roughness: 0.4 }
    PosterExpo "Print: expo" PLASTERBOARD 0.0125 { texture: Some(Tex::PosterExpo), base: [0.95; 3], roughness: 0.7 }
    PosterWaves "Print: waves" PLASTERBOARD 0.0125 { texture: Some(Tex::PosterWaves), base: [0.95; 3], roughness: 0.7 }
    PosterChart "Print: chart" PLASTERBOARD 0.0125 { texture: Some(Tex::PosterChart), base: [0.95; 3], roughness: 0.7 }
    PosterMap "Print: map" PLASTERBOARD 0.0125 { texture: Some(Tex::PosterMap), base: [0.95; 3], roughness: 0.7 }
    PosterGrid "Print: grid" PLASTERBOARD 0.0125 { texture: Some(Tex::PosterGrid), base: [0.95; 3], roughness: 0.7 }
    PosterHills "Print: hills" PLASTERBOARD 0.0125 { texture: Some(Tex::PosterHills), base: [0.95; 3], roughness: 0.7 }
    Painting "Painting" CLOTH 0.003 { texture: Some(Tex::Painting), base: [0.95; 3], roughness: 0.8 }
    ScreenWelcome "Welcome screen" GLASS 0.004 { texture: Some(Tex::ScreenWelcome), base: [0.02; 3], emissive: [1.6; 3], roughness: 0.2 }
    ScreenSchedule "Schedule screen" GLASS 0.004 { texture: Some(Tex::ScreenDepartures), base: [0.02; 3], emissive: [1.6; 3], roughness: 0.2 }
    ScreenDesk "Desk screen" GLASS 0.004 { texture: Some(Tex::ScreenDesk), base: [0.02; 3], emissive: [0.9; 3], roughness: 0.25 }
    LiftSign "Lift indicator" GLASS 0.004 { texture: Some(Tex::LiftSign), base: [0.02; 3], emissive: [1.5; 3], roughness: 0.25 }
    Exit "Exit sign" PLASTIC 0.004 { texture: Some(Tex::Exit), base: [0.1; 3], emissive: [1.8; 3], roughness: 0.4 }
    LightPanel "Light panel" PLASTIC 0.004 { emissive: [PANEL, PANEL * 0.965, PANEL * 0.9], roughness: 0.6 }
    UpLight "Suspended light" PLASTIC 0.004 { emissive: [PANEL * 1.3, PANEL * 1.22, PANEL * 1.08], roughness: 0.6 }
    Downlight "Downlight" GLASS 0.003 { emissive: [24.0, 19.5, 14.0], roughness: 0.5 }
    PendantGlow "Pendant glass" GLASS 0.003 { emissive: [9.0, 6.2, 3.4], roughness: 0.5 }
    LampShade "Lamp shade" CLOTH 0.001 { base: [0.8, 0.7, 0.5], emissive: [1.5, 1.05, 0.55], roughness: 1.0 }
    Street "Street outside" FOLIAGE 0.5 { texture: Some(Tex::Street), base: [0.0; 3], emissive: [DAYLIGHT; 3], roughness: 1.0 }
    // Thin coverings on concrete: what radio meets is the slab below.
    CarpetTiles "Carpet tiles on concrete" CONCRETE 0.2 { texture: Some(Tex::CarpetTiles), base: [0.95; 3], texture_size_m: [2.0, 2.0], roughness: 1.0 }
    CarpetTilesWarm "Warm carpet tiles on concrete" CONCRETE 0.2 { texture: Some(Tex::CarpetTiles), base: [1.0, 0.72, 0.5], texture_size_m: [2.0, 2.0], roughness: 1.0 }
    Vinyl "Vinyl floor on concrete" CONCRETE 0.2 { texture: Some(Tex::Vinyl), base: [0.95; 3], texture_size_m: [1.6, 1.6], roughness: 0.4 }
    PaintedConcrete "Painted concrete" CONCRETE 0.2 { texture: Some(Tex::Plaster), base: [0.9, 0.9, 0.88], texture_size_m: [1.5, 1.5], roughness: 0.9 }
    PlasterGreen "Sage plaster" PLASTERBOARD 0.0125 { texture: Some(Tex::Plaster), base: [0.3, 0.42, 0.31], texture_size_m: [1.5, 1.5], roughness: 0.9 }
    Backsplash "Wall tiles" MARBLE 0.008 { texture: Some(Tex::WallTiles), base: [0.95; 3], texture_size_m: [0.6, 0.6], roughness: 0.25 }
    Whiteboard "Whiteboard" METAL 0.001 { texture: Some(Tex::Whiteboard), base: [0.95; 3], roughness: 0.25 }
    Film "Frosted film" PLASTIC 0.0002 { base: [0.85; 3], roughness: 0.9 }
    ScreenCode "Screen with text" GLASS 0.004 { texture: Some(Tex::ScreenCode), base: [0.02; 3], emissive: [1.2; 3], roughness: 0.25 }
    SignMeeting "Door sign: meeting" PLASTIC 0.003 { texture: Some(Tex::SignMeeting), base: [0.95; 3], roughness: 0.5 }
    SignPrint "Door sign: print" PLASTIC 0.003 { texture: Some(Tex::SignPrint), base: [0.95; 3], roughness: 0.5 }
    SignKitchen "Door sign: kitchen" PLASTIC 0.003 { texture: Some(Tex::SignKitchen), base: [0.95; 3], roughness: 0.5 }
    SignOffice "Door sign: office" PLASTIC 0.003 { texture: Some(Tex::SignOffice), base: [0.95; 3], roughness: 0.5 }
}

impl MaterialSpec {
    /// Conductivity at 60 GHz of a loss tangent: σ = ε_r tanδ ωε₀, S/m.
    pub fn conductivity_s_per_m(relative_permittivity: f64, loss_tangent: f64) -> f64 {
        /// ωε₀ at 60 GHz, S/m.
        const OMEGA_EPSILON_0: f64 = std::f64::consts::TAU * 60e9 * crate::itu::VACUUM_PERMITTIVITY_F_PER_M;
        // Four digits: more would claim a knowledge nobody has.
        (relative_permittivity * loss_tangent * OMEGA_EPSILON_0 * 1e4).round() / 1e4
    }
}
