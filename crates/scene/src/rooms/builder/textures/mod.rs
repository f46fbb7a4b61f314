//! Textures painted in code: every one is a pure function of its name.

mod fabrics;
mod noise;
mod office;
mod posters;
mod signs;
mod stone;
mod wood;

pub use signs::SPINES;

use crate::draw::{Canvas, PictureFormat, hex};

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
            pub fn format(self) -> PictureFormat {
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
const PHOTO: PictureFormat = PictureFormat::Jpeg(86);

textures! {
    FloorTiles => "floor_tiles", PHOTO, stone::floor_tiles();
    FloorTilesNormal => "floor_tiles_normal", PictureFormat::Png, stone::floor_tiles_normal();
    MarbleWhite => "marble_white", PHOTO, stone::marble_white();
    MarbleGreen => "marble_green", PHOTO, stone::marble_green();
    Concrete => "concrete_formed", PHOTO, stone::concrete();
    Terrazzo => "terrazzo", PHOTO, stone::terrazzo();
    Plaster => "plaster", PHOTO, stone::plaster();
    Ceiling => "ceiling_boards", PHOTO, stone::ceiling();
    Soil => "soil", PHOTO, stone::soil();
    FloorBoards => "floor_boards", PHOTO, wood::floor_boards();
    Oak => "oak", PHOTO, wood::oak();
    OakNormal => "wood_normal", PictureFormat::Jpeg(90), wood::wood_normal();
    Walnut => "walnut", PHOTO, wood::walnut();
    Leather => "leather", PHOTO, fabrics::leather();
    LeatherNormal => "leather_normal", PictureFormat::Jpeg(82), fabrics::leather_normal();
    Weave => "weave", PHOTO, fabrics::weave();
    WeaveNormal => "weave_normal", PictureFormat::Jpeg(90), fabrics::weave_normal();
    Rug => "rug", PHOTO, fabrics::rug();
    Mat => "entrance_mat", PHOTO, fabrics::entrance_mat();
    Brushed => "brushed_metal", PHOTO, fabrics::brushed();
    Leaf => "leaf", PHOTO, fabrics::leaf();
    PosterExpo => "poster_expo", PictureFormat::Png, posters::expo();
    PosterWaves => "poster_waves", PHOTO, posters::waves();
    PosterChart => "poster_chart", PictureFormat::Png, posters::chart();
    PosterMap => "poster_map", PictureFormat::Png, posters::map();
    PosterGrid => "poster_grid", PictureFormat::Png, posters::grid();
    PosterHills => "poster_hills", PictureFormat::Png, posters::hills();
    Painting => "painting", PHOTO, posters::painting();
    Notices => "notice_board", PHOTO, posters::notices();
    ScreenWelcome => "screen_welcome", PHOTO, signs::screen_welcome();
    ScreenDepartures => "screen_schedule", PictureFormat::Png, signs::screen_schedule();
    ScreenDesk => "screen_desk", PictureFormat::Png, signs::screen_desk();
    Clock => "clock", PictureFormat::Png, signs::clock();
    Exit => "exit_sign", PictureFormat::Png, signs::exit();
    Vending => "vending_front", PictureFormat::Png, signs::vending();
    LiftSign => "lift_sign", PictureFormat::Png, signs::lift();
    Keyboard => "keyboard", PictureFormat::Png, signs::keyboard();
    Books => "book_spines", PHOTO, signs::books();
    Street => "street", PHOTO, signs::street();
    CarpetTiles => "carpet_tiles", PHOTO, office::carpet_tiles();
    Vinyl => "vinyl", PHOTO, office::vinyl();
    WallTiles => "wall_tiles", PHOTO, office::wall_tiles();
    Whiteboard => "whiteboard", PictureFormat::Png, office::whiteboard();
    ScreenCode => "screen_code", PictureFormat::Png, office::screen_code();
    SignMeeting => "sign_meeting", PictureFormat::Png, office::sign("MEETING", "4.03", hex(0x1f6f78));
    SignPrint => "sign_print", PictureFormat::Png, office::sign("PRINT", "4.02", hex(0xb5651d));
    SignKitchen => "sign_kitchen", PictureFormat::Png, office::sign("KITCHEN", "4.06", hex(0x6b8f3a));
    SignOffice => "sign_office", PictureFormat::Png, office::sign("OFFICE", "4.05", hex(0x3d4f7c));
}
