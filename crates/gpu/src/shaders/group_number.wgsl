// Number of a workgroup in a dispatch that is folded into rows.
fn group_number(id: vec3<u32>) -> u32 { return id.y * 32768u + id.x; }
