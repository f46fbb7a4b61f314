// The correction of an emitter's log gain between a receiver's anchors: the mean of their corrections, or of what they are the logarithms of.
fn correction(e: u32, receiver: ReceiverRow) -> f32 {
    var sum = 0.0;
    if (receiver.powers == 0u || receiver.anchors == 0u) {
        for (var k = 0u; k < receiver.anchors; k++) {
            let anchor = anchors[receiver.first + k];
            sum += anchor.weight * seen_from[anchor.number * job.emitters + e];
        }
        return sum;
    }
    var most = seen_from[anchors[receiver.first].number * job.emitters + e];
    for (var k = 1u; k < receiver.anchors; k++) {
        most = max(most, seen_from[anchors[receiver.first + k].number * job.emitters + e]);
    }
    for (var k = 0u; k < receiver.anchors; k++) {
        let anchor = anchors[receiver.first + k];
        sum += anchor.weight * exp(seen_from[anchor.number * job.emitters + e] - most);
    }
    return most + log(sum);
}
