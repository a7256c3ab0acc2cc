//! The paints of the parts, as glTF materials.

/// A paint.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Paint {
    Red,
    Cream,
    Steel,
    Brass,
    Wood,
    Rubber,
    Leather,
    Glass,
    Feather,
    Beak,
    Silk,
    Grass,
    Meadow,
    Road,
    Leaf,
    Fir,
    Plaster,
    Roof,
    Cloud,
    Window,
    PortLamp,
    StarboardLamp,
}

/// The parameters of a material.
pub struct Look {
    /// Base colour, linear.
    pub color: [f32; 3],
    /// From 0 to 1.
    pub metallic: f32,
    /// From 0 (a mirror) to 1.
    pub roughness: f32,
    /// Emission as a multiple of the colour.
    pub glow: f32,
}

impl Paint {
    /// The parameters of its material.
    pub fn look(self) -> Look {
        let look = |color, metallic, roughness, glow| Look { color, metallic, roughness, glow };
        let matte = |color| look(color, 0.0, 1.0, 0.0);
        let gloss = |color, roughness| look(color, 0.0, roughness, 0.0);
        let metal = |color, roughness| look(color, 1.0, roughness, 0.0);
        let lamp = |color, glow| look(color, 0.0, 1.0, glow);
        match self {
            Paint::Red => gloss([0.62, 0.03, 0.02], 0.35),
            Paint::Cream => gloss([0.84, 0.70, 0.46], 0.6),
            Paint::Steel => metal([0.72, 0.74, 0.77], 0.35),
            Paint::Brass => metal([0.88, 0.60, 0.22], 0.35),
            Paint::Wood => gloss([0.22, 0.09, 0.03], 0.5),
            Paint::Rubber => matte([0.02, 0.02, 0.025]),
            Paint::Leather => gloss([0.13, 0.05, 0.02], 0.6),
            Paint::Glass => gloss([0.01, 0.012, 0.015], 0.2),
            Paint::Feather => matte([0.88, 0.62, 0.06]),
            Paint::Beak => gloss([0.80, 0.25, 0.02], 0.5),
            Paint::Silk => gloss([0.02, 0.28, 0.42], 0.7),
            Paint::Grass => matte([0.17, 0.36, 0.05]),
            Paint::Meadow => matte([0.30, 0.46, 0.08]),
            Paint::Road => matte([0.55, 0.42, 0.26]),
            Paint::Leaf => matte([0.10, 0.27, 0.04]),
            Paint::Fir => matte([0.03, 0.15, 0.06]),
            Paint::Plaster => matte([0.80, 0.76, 0.68]),
            Paint::Roof => matte([0.48, 0.11, 0.04]),
            Paint::Cloud => matte([0.93, 0.93, 0.95]),
            Paint::Window => lamp([1.0, 0.62, 0.18], 2.5),
            Paint::PortLamp => lamp([1.0, 0.03, 0.02], 4.0),
            Paint::StarboardLamp => lamp([0.02, 0.8, 0.1], 4.0),
        }
    }
}
