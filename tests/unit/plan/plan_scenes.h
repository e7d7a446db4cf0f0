#pragma once

#include <memory>
#include <string>
#include <vector>

#include "tests/support/gltf_fixture.h"
#include "worker/plan/plan.h"
#include "worker/render/lights/environment.h"
#include "worker/scene/scene.h"

/// Tiny scenes, each of which needs some part of the model only.
namespace lumifold::plan {

scene::Material Mirror();
scene::Material ClearPane();

/// A closed box of these six materials (see testing::PlaceBoxInside) seen from inside.
scene::Scene Box(const scene::Material& walls);
/// The same with a quad light at its ceiling.
scene::Scene LitBox(const scene::Material& walls);
/// One quad that faces the camera, in the plane z = 0.
scene::Scene Sheet(const scene::Material& material);

/// A lit room in which a mirror appears: its node has scale 0 until frame 30, 1.25 s.
scene::GltfFixture RoomWithLateMirror();

/// A white environment.
std::shared_ptr<const render::Environment> WhiteSky();

/// Adds a picture of the given texels (RGBA, one row) and a texture of it; returns the texture's number.
int AddTexture(const std::vector<uint8_t>& rgba, scene::Scene* scene);

/// Samples per pixel of a job that may have the largest probe.
inline constexpr int32_t kAmpleSamples = 1 << 16;

PlanSettings SettingsFor(std::shared_ptr<const render::Environment> sky = nullptr);

/// Probes and plans; fails the test on errors.
Plan PlanOf(const scene::Scene& scene, const PlanSettings& settings = SettingsFor());

/// Of the decision of this name.
const Decision& Find(const Plan& plan, const std::string& name);
/// Its value, as text.
std::string ValueOf(const Plan& plan, const std::string& name);
/// All that is in the plan, as text.
std::string TextOf(const Plan& plan);

}  // namespace lumifold::plan
