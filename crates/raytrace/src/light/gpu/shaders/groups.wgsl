// Workgroups lie in rows of 32768.
fn group_number(id: vec3<u32>) -> u32 {
    return id.y * 32768u + id.x;
}
