//! Layout of the office's furniture, room by room. The platform's way stays clear: in by the open office's door, round the desks, out by
//! its opening, up the corridor's southern leg, round the bend and back along the corridor.

use super::furniture::{cluster, copier, cupboard, desk, meeting_table, paper_boxes};
use super::kitchen;
use crate::builder::decor;
use crate::builder::furniture::{bench, chair, office_chair, round_table, sofa};
use crate::builder::materials::Mat;
use crate::builder::mesh_builder::{BuiltObject, LocalFrame};

/// All loose objects.
pub fn place(all: &mut Vec<BuiltObject>) {
    open_office(all);
    print_nook(all);
    meeting_room(all);
    offices(all);
    kitchen_room(all);
    corridor(all);
}

fn plant(name: &str, seed: u64, pot: Mat, x: f64, y: f64) -> BuiltObject {
    decor::crown_plant(name, seed, pot, Mat::Leaf, 0.5, 0.42, 36).placed(&LocalFrame::at(x, y, 0.0))
}

fn open_office(all: &mut Vec<BuiltObject>) {
    all.extend(cluster("Western desks", 0, Mat::ClothTeal, 90.0, 3.0, 1.85));
    all.extend(cluster("Eastern desks", 4, Mat::ClothRust, 90.0, 8.0, 3.75));
    all.push(decor::bookcase("Bookcase of the open office", 61, 1.9, 1.85).placed(&LocalFrame::yaw(90.0, 0.002, 1.05, 0.0)));
    all.push(cupboard(Mat::GreyMetal).copy("Steel cupboard of the open office", 90.0, 0.002, 3.5, 0.0));
    all.push(plant("Dracaena in the corner", 62, Mat::ConcretePot, 0.5, 0.5));
    all.push(sofa(2, Mat::ClothMustard, Mat::ClothTeal).copy("Sofa of the open office", -90.0, 10.48, 3.35, 0.0));
    all.push(decor::tree("Ficus of the open office", 63, Mat::ConcretePot, 1.8, 150).placed(&LocalFrame::at(5.9, 0.6, 0.0)));
    all.push(decor::bin(Mat::Brushed).copy("Bin of the open office", 0.0, 6.1, 5.2, 0.0));
    all.push(decor::planter("Planter of the open office", 64, 1.4).placed(&LocalFrame::at(4.2, 5.2, 0.0)));
}

fn print_nook(all: &mut Vec<BuiltObject>) {
    all.push(copier().copy("Copier", 0.0, 1.2, 11.62, 0.0));
    all.push(decor::bookcase("Shelves of the print nook", 71, 0.95, 2.0).placed(&LocalFrame::at(1.75, 11.998, 0.0)));
    all.push(cupboard(Mat::WhiteMetal).copy("White cupboard of the print nook", -90.0, 3.148, 10.4, 0.0));
    all.push(paper_boxes().copy("Paper boxes", 0.0, 0.5, 11.6, 0.0));
    all.push(decor::bin(Mat::BluePlastic).copy("Bin for paper", 0.0, 0.3, 10.6, 0.0));
    all.push(decor::bin(Mat::GreenPlastic).copy("Bin for glass", 0.0, 0.3, 10.1, 0.0));
}

fn meeting_room(all: &mut Vec<BuiltObject>) {
    let (x, y) = (5.6, 9.75);
    all.push(meeting_table().copy("Meeting table", 0.0, x, y, 0.0));
    for (i, (dx, dy, turn)) in [
        (-0.8, -0.95, 176.0),
        (0.05, -1.0, 190.0),
        (0.85, -0.92, 172.0),
        (-0.85, 0.95, 5.0),
        (0.0, 0.98, -8.0),
        (0.8, 1.02, 14.0),
    ]
    .into_iter()
    .enumerate()
    {
        let cover = [Mat::ClothGrey, Mat::ClothRust, Mat::ClothGrey][i % 3];
        all.push(chair(cover).copy(format!("Meeting chair {}", i + 1), turn, x + dx, y + dy, 0.0));
    }
    all.push(plant("Palm of the meeting room", 81, Mat::Clay, 3.75, 11.45));
    all.push(decor::bookcase("Low shelf of the meeting room", 82, 0.95, 0.8).placed(&LocalFrame::at(7.0, 11.998, 0.0)));
}

/// The closed office and the one behind glass.
fn offices(all: &mut Vec<BuiltObject>) {
    for (name, variant, turn, x, y, seat_turn) in
        [("closed office", 1, 90.0, 10.9, 10.2, 82.0), ("glazed office", 4, 180.0, 15.6, 1.7, 195.0)]
    {
        all.push(desk(variant).copy(format!("Desk of the {name}"), turn, x, y, 0.0));
        let (dx, dy) = if turn == 90.0 { (-0.78, 0.05) } else { (0.05, -0.8) };
        all.push(office_chair(Mat::LeatherBlack).copy(format!("Chair of the {name}"), seat_turn, x + dx, y + dy, 0.0));
    }
    let case = decor::bookcase("Bookcase of the closed office", 91, 1.9, 2.2);
    all.push(case.placed(&LocalFrame::yaw(-90.0, 12.948, 11.0, 0.0)));
    let shelf = decor::bookcase("Bookcase of the glazed office", 92, 1.9, 1.85);
    all.push(shelf.placed(&LocalFrame::yaw(-90.0, 17.998, 3.0, 0.0)));
    all.push(chair(Mat::ClothTeal).copy("Visitor's chair", 0.0, 15.5, 2.75, 0.0));
    all.push(plant("Fern of the glazed office", 93, Mat::ConcretePot, 13.55, 0.5));
}

fn kitchen_room(all: &mut Vec<BuiltObject>) {
    // Along the east wall, its front towards the west.
    all.push(kitchen::counter(6).copy("Kitchen counter", -90.0, 17.998, 9.2, 0.0));
    all.push(kitchen::refrigerator().copy("Refrigerator", -90.0, 17.998, 9.85, 0.0));
    all.push(decor::vending_machine().copy("Vending machine", 0.0, 13.6, 11.6, 0.0));
    all.push(decor::water_cooler().copy("Water cooler", 90.0, 13.25, 8.0, 0.0));
    for (i, (x, y)) in [(15.1, 6.3), (15.3, 9.0)].into_iter().enumerate() {
        all.push(round_table(0.45, 0.74, Mat::MarbleWhite).copy(format!("Kitchen table {}", i + 1), 0.0, x, y, 0.0));
        for (k, (dx, dy, turn)) in [(0.75, 0.1, -85.0), (-0.2, 0.75, 12.0), (-0.15, -0.75, 190.0)].into_iter().enumerate() {
            let cover = [Mat::ClothMustard, Mat::ClothTeal, Mat::ClothRust][(k + i) % 3];
            all.push(chair(cover).copy(format!("Kitchen chair {}", 3 * i + k + 1), turn, x + dx, y + dy, 0.0));
        }
    }
    all.push(decor::bin(Mat::Brushed).copy("Bin of the kitchen", 0.0, 17.6, 4.4, 0.0));
    all.push(plant("Palm of the kitchen", 101, Mat::ConcretePot, 13.55, 4.55));
    all.push(bench(1.6, Mat::LeatherTan).copy("Bench of the kitchen", 0.0, 15.6, 11.4, 0.0));
}

fn corridor(all: &mut Vec<BuiltObject>) {
    let extinguisher = decor::extinguisher().placed(&LocalFrame::yaw(-90.0, 12.85, 4.98, 0.6));
    all.push(BuiltObject { name: "Fire extinguisher".into(), ..extinguisher });
    all.push(plant("Dracaena at the bend", 111, Mat::Clay, 12.45, 6.95));
}
