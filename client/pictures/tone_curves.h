#pragma once

/// Curves from linear light of a scene to linear light of a display that change the three colours together.
/// The result is 0 to 1.
namespace lumifold::pictures {

/// AgX with its base look, as Blender shows pictures by default since 4.0: bright and saturated light fades
/// to white instead of changing its hue.
/// Source: Sobotka 2022, AgX; the polynomial of Wrensch 2023, "Minimal AgX Implementation".
void AgX(float rgb[3]);

/// Khronos PBR Neutral: colours below 0.8 stay as they are, less the reflection of a dielectric, so that
/// products have the colours of their material.
/// Source: Khronos Group 2024, "Khronos PBR Neutral Tone Mapper".
void PbrNeutral(float rgb[3]);

}  // namespace lumifold::pictures
