//! Layout of the lobby's furniture. The ring the platform travels stays clear; islands inside it, furniture along the walls.

use crate::builder::decor;
use crate::builder::furniture::{bench, chair, coffee_table, office_chair, reception_desk, round_table, sofa, stool};
use crate::builder::materials::Mat;
use crate::builder::mesh_builder::{BuiltObject, LocalFrame};
use crate::builder::shapes::{block, printed_box, v};

/// All loose objects.
pub fn objects() -> Vec<BuiltObject> {
    let mut all = Vec::new();
    lounge(&mut all);
    reception(&mut all);
    along_the_window(&mut all);
    niche(&mut all);
    north_arm(&mut all);
    all
}

/// Sofas round a marble table on a rug, in the middle of the hall.
fn lounge(all: &mut Vec<BuiltObject>) {
    let (x, y) = (5.65, 5.1);
    all.push(
        BuiltObject::new("Rug in the lounge")
            .with(Mat::Rug, printed_box(v(x - 2.1, y - 1.55, 0.001), v(x + 2.1, y + 1.55, 0.013))),
    );
    let leather = sofa(3, Mat::LeatherTan, Mat::ClothTeal);
    all.push(leather.copy("Sofa south", 180.0, x, y - 1.3, 0.012));
    all.push(leather.copy("Sofa north", 0.0, x, y + 1.3, 0.012));
    let armchair = sofa(1, Mat::ClothMustard, Mat::ClothGrey);
    all.push(armchair.copy("Armchair 1", -90.0, x + 1.85, y + 0.02, 0.012));
    all.push(sofa(1, Mat::ClothTeal, Mat::ClothRust).copy("Armchair 2", 78.0, x - 1.85, y - 0.05, 0.012));
    all.push(coffee_table(1.25, 0.7, Mat::MarbleWhite).copy("Coffee table", 0.0, x, y, 0.013));
    all.push(round_table(0.26, 0.5, Mat::Walnut).copy("Side table", 0.0, x + 1.55, y + 1.35, 0.013));
    all.push(decor::table_lamp().copy("Table lamp", 0.0, x + 1.55, y + 1.35, 0.513));
    all.push(decor::floor_lamp().copy("Floor lamp", 0.0, x - 1.6, y + 1.55, 0.013));
    all.push(decor::tree("Ficus in the lounge", 11, Mat::ConcretePot, 1.9, 190).placed(&LocalFrame::at(
        x + 1.75,
        y - 1.5,
        0.013,
    )));
}

fn reception(all: &mut Vec<BuiltObject>) {
    // The desk's front looks west.
    let place = LocalFrame::yaw(-90.0, 11.35, 5.3, 0.0);
    all.push(reception_desk().placed(&place));
    all.extend(decor::desk_things().into_iter().map(|o| o.placed(&place)));
    let clerk = office_chair(Mat::LeatherBlack);
    all.push(clerk.copy("Office chair 1", 95.0, 12.2, 5.95, 0.0));
    all.push(clerk.copy("Office chair 2", 62.0, 12.35, 4.9, 0.0));
    for i in 0..5 {
        let y = 3.1 + 0.92 * f64::from(i);
        let mut o =
            BuiltObject::new(format!("Steel cabinet {}", i + 1)).with(Mat::GreyMetal, block(0.0, 0.0, 0.0, [0.9, 0.42, 0.88]));
        for z in [0.16, 0.45, 0.74] {
            o.add(Mat::Chrome, block(0.0, -0.22, z, [0.16, 0.02, 0.018]));
        }
        o.add(Mat::DarkMetal, block(0.0, -0.212, 0.29, [0.88, 0.004, 0.006]))
            .add(Mat::DarkMetal, block(0.0, -0.212, 0.58, [0.88, 0.004, 0.006]));
        all.push(o.copy(format!("Steel cabinet {}", i + 1), -90.0, 13.74, y, 0.0));
    }
    all.push(
        decor::crown_plant("Fern on the cabinets", 21, Mat::Clay, Mat::Leaf, 0.0, 0.3, 40)
            .placed(&LocalFrame::at(13.6, 2.95, 0.88)),
    );
    all.push(
        decor::crown_plant("Dracaena at the desk", 22, Mat::ConcretePot, Mat::LeafPale, 0.7, 0.7, 44)
            .placed(&LocalFrame::at(11.3, 7.65, 0.0)),
    );
    all.push(decor::stanchions(&[[10.95, 2.55], [12.35, 2.55], [13.6, 2.4]]));
}

fn along_the_window(all: &mut Vec<BuiltObject>) {
    all.push(BuiltObject::new("Entrance mat").with(Mat::RibbedCloth, block(10.4, 0.75, 0.001, [2.0, 1.3, 0.011])));
    all.push(decor::umbrella_stand().placed(&LocalFrame::at(9.0, 0.3, 0.0)));
    all.push(sofa(1, Mat::ClothGrey, Mat::ClothRust).copy("Armchair at the window 1", 150.0, 3.1, 0.75, 0.0));
    all.push(sofa(1, Mat::ClothGrey, Mat::ClothMustard).copy("Armchair at the window 2", 205.0, 4.9, 0.75, 0.0));
    all.push(round_table(0.28, 0.5, Mat::Oak).copy("Table at the window", 0.0, 4.0, 0.7, 0.0));
    all.push(
        decor::crown_plant("Palm at the window", 31, Mat::ConcretePot, Mat::Leaf, 0.5, 0.72, 40)
            .placed(&LocalFrame::at(0.98, 0.95, 0.0)),
    );
    all.push(decor::planter("Planter at the window", 32, 1.8).placed(&LocalFrame::at(7.2, 0.45, 0.0)));
    all.push(bench(1.6, Mat::LeatherBlack).copy("Bench under the posters", 90.0, 0.42, 3.1, 0.0));
    all.push(decor::bin(Mat::Brushed).copy("Bin at the entrance", 0.0, 11.62, 0.32, 0.0));
    all.push(decor::tree("Ficus on the landing", 33, Mat::Clay, 1.75, 150).placed(&LocalFrame::at(13.35, 0.65, 0.45)));
    let extinguisher = decor::extinguisher().placed(&LocalFrame::at(0.19, 9.45, 0.6));
    all.push(BuiltObject { name: "Fire extinguisher".into(), ..extinguisher });
}

fn niche(all: &mut Vec<BuiltObject>) {
    all.push(decor::vending_machine().placed(&LocalFrame::at(13.4, 8.58, 0.0)));
    all.push(decor::water_cooler().copy("Water cooler", 0.0, 12.55, 8.78, 0.0));
    all.push(bench(1.9, Mat::ClothTeal).copy("Bench in the niche", 0.0, 10.2, 8.62, 0.0));
    all.push(decor::bin(Mat::GreenPlastic).copy("Bin green", 0.0, 8.85, 8.72, 0.0));
    all.push(decor::bin(Mat::BluePlastic).copy("Bin blue", 0.0, 11.55, 8.72, 0.0));
}

fn north_arm(all: &mut Vec<BuiltObject>) {
    // Bar table with stools, a café table with chairs, planters between.
    all.push(round_table(0.42, 1.06, Mat::Walnut).copy("Bar table 1", 0.0, 3.7, 11.3, 0.0));
    all.push(round_table(0.42, 1.06, Mat::Walnut).copy("Bar table 2", 0.0, 4.7, 11.3, 0.0));
    for (i, (x, y)) in [(3.45, 10.7), (4.85, 10.7), (3.55, 11.95), (4.75, 11.92)].into_iter().enumerate() {
        let cover = if i % 2 == 0 { Mat::LeatherTan } else { Mat::LeatherBlack };
        all.push(stool(cover).copy(format!("Bar stool {}", i + 1), 17.0 * i as f64, x, y, 0.0));
    }
    all.push(decor::planter("Planter in the north arm", 41, 1.6).placed(&LocalFrame::at(4.3, 9.75, 0.0)));
    all.push(round_table(0.4, 0.74, Mat::MarbleGreen).copy("Café table", 0.0, 5.2, 8.5, 0.0));
    for (i, (turn, x, y, cover)) in
        [(200.0, 5.0, 7.8, Mat::ClothRust), (80.0, 4.5, 8.55, Mat::ClothGrey), (-95.0, 5.9, 8.5, Mat::ClothMustard)]
            .into_iter()
            .enumerate()
    {
        all.push(chair(cover).copy(format!("Chair {}", i + 1), turn + if i == 0 { -20.0 } else { 0.0 }, x, y, 0.0));
    }
    let case = decor::bookcase("Bookcase", 51, 3.0, 2.2);
    all.push(case.placed(&LocalFrame::at(1.75, 14.998, 0.0)));
    all.push(sofa(2, Mat::LeatherBlack, Mat::ClothMustard).copy("Sofa at the screen", -90.0, 7.95, 12.0, 0.0));
    all.push(
        decor::crown_plant("Palm in the corner", 42, Mat::ConcretePot, Mat::Leaf, 0.8, 0.66, 42)
            .placed(&LocalFrame::at(7.7, 14.2, 0.0)),
    );
    all.push(decor::tree("Ficus at the lifts", 43, Mat::ConcretePot, 2.0, 170).placed(&LocalFrame::at(0.72, 13.85, 0.0)));
    all.push(decor::bin(Mat::Brushed).copy("Bin at the lifts", 0.0, 0.38, 11.5, 0.0));
}
