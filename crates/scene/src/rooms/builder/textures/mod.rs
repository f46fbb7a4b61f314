//! Textures painted in code: every one is a pure function of its name.

mod fabrics;
mod noise;
mod office;
mod posters;
mod signs;
mod stone;
mod wood;

pub use signs::SPINES;

use crate::draw::{Canvas, Format, hex};

/// Every texture: its name in the file, its encoding and its painter.
macro_rules! textures {
    ($($variant:ident => $name:literal, $format:expr, $paint:expr;)*) => {
        /// A texture by name.
        #[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
        #[allow(missing_docs)]
        pub enum Tex { $($variant),* }

        impl Tex {
            /// Name in the file.
            pub fn name(self) -> &'static str {
                match self { $(Tex::$variant => $name),* }
            }

            /// PNG or JPEG.
            pub fn format(self) -> Format {
                match self { $(Tex::$variant => $format),* }
            }

            /// Paints it.
            pub fn paint(self) -> Canvas {
                match self { $(Tex::$variant => $paint),* }
            }
        }
    };
}

/// Photo-like surfaces: the quality at which blocks stop showing.
const PHOTO: Format = Format::Jpeg(86);

textures! {
    FloorTiles => "floor_tiles", PHOTO, stone::floor_tiles();
    FloorTilesNormal => "floor_tiles_normal", Format::Png, stone::floor_tiles_normal();
    MarbleWhite => "marble_white", PHOTO, stone::marble_white();
    MarbleGreen => "marble_green", PHOTO, stone::marble_green();
    Concrete => "concrete_formed", PHOTO, stone::concrete();
    Terrazzo => "terrazzo", PHOTO, stone::terrazzo();
    Plaster => "plaster", PHOTO, stone::plaster();
    Ceiling => "ceiling_boards", PHOTO, stone::ceiling();
    Soil => "soil", PHOTO, stone::soil();
    FloorBoards => "floor_boards", PHOTO, wood::floor_boards();
    Oak => "oak", PHOTO, wood::oak();
    OakNormal => "wood_normal", Format::Jpeg(90), wood::wood_normal();
    Walnut => "walnut", PHOTO, wood::walnut();
    Leather => "leather", PHOTO, fabrics::leather();
    LeatherNormal => "leather_normal", Format::Jpeg(82), fabrics::leather_normal();
    Weave => "weave", PHOTO, fabrics::weave();
    WeaveNormal => "weave_normal", Format::Jpeg(90), fabrics::weave_normal();
    Rug => "rug", PHOTO, fabrics::rug();
    Mat => "entrance_mat", PHOTO, fabrics::entrance_mat();
    Brushed => "brushed_metal", PHOTO, fabrics::brushed();
    Leaf => "leaf", PHOTO, fabrics::leaf();
    PosterExpo => "poster_expo", Format::Png, posters::expo();
    PosterWaves => "poster_waves", PHOTO, posters::waves();
    PosterChart => "poster_chart", Format::Png, posters::chart();
    PosterMap => "poster_map", Format::Png, posters::map();
    PosterGrid => "poster_grid", Format::Png, posters::grid();
    PosterHills => "poster_hills", Format::Png, posters::hills();
    Painting => "painting", PHOTO, posters::painting();
    Notices => "notice_board", PHOTO, posters::notices();
    ScreenWelcome => "screen_welcome", PHOTO, signs::screen_welcome();
    ScreenDepartures => "screen_schedule", Format::Png, signs::screen_schedule();
    ScreenDesk => "screen_desk", Format::Png, signs::screen_desk();
    Clock => "clock", Format::Png, signs::clock();
    Exit => "exit_sign", Format::Png, signs::exit();
    Vending => "vending_front", Format::Png, signs::vending();
    LiftSign => "lift_sign", Format::Png, signs::lift();
    Keyboard => "keyboard", Format::Png, signs::keyboard();
    Books => "book_spines", PHOTO, signs::books();
    Street => "street", PHOTO, signs::street();
    CarpetTiles => "carpet_tiles", PHOTO, office::carpet_tiles();
    Vinyl => "vinyl", PHOTO, office::vinyl();
    WallTiles => "wall_tiles", PHOTO, office::wall_tiles();
    Whiteboard => "whiteboard", Format::Png, office::whiteboard();
    ScreenCode => "screen_code", Format::Png, office::screen_code();
    SignMeeting => "sign_meeting", Format::Png, office::sign("MEETING", "4.03", hex(0x1f6f78));
    SignPrint => "sign_print", Format::Png, office::sign("PRINT", "4.02", hex(0xb5651d));
    SignKitchen => "sign_kitchen", Format::Png, office::sign("KITCHEN", "4.06", hex(0x6b8f3a));
    SignOffice => "sign_office", Format::Png, office::sign("OFFICE", "4.05", hex(0x3d4f7c));
}
