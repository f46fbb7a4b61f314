// array_field/cloud.rs, `log_gain`: the correction of an emitter's log gain between a receiver's anchors.
fn correction(e: u32, receiver: ReceiverRow) -> f32 {
    var sum = 0.0;
    for (var k = 0u; k < receiver.anchors; k++) {
        let anchor = anchors[receiver.first + k];
        sum += anchor.weight * seen_from[anchor.number * job.emitters + e];
    }
    return sum;
}
