//! Rebuilds the committed lobby: `cargo run --release -p corf-scene --example build_lobby -- scenes/lobby.glb`.

fn main() -> corf_scene::Result<()> {
    let path = std::env::args().nth(1).unwrap_or_else(|| "scenes/lobby.glb".into());
    corf_scene::lobby::write(&path)?;
    println!("{path}");
    Ok(())
}
