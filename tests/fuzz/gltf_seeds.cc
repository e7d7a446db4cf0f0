// Writes the sample documents to a folder, as GLB and in the fuzz target's own format.

#include <cstdio>
#include <filesystem>
#include <fstream>
#include <string>

#include "tests/support/gltf_samples.h"

int main(int argc, char** argv) {
  if (argc != 2) {
    std::fprintf(stderr, "usage: gltf_seeds FOLDER\n");
    return 2;
  }
  const std::filesystem::path folder = argv[1];
  for (const auto& [name, fixture] : lumifold::scene::SampleDocuments()) {
    std::ofstream(folder / (name + ".glb"), std::ios::binary) << fixture.Glb();
    std::ofstream parts(folder / (name + ".parts"), std::ios::binary);
    parts << fixture.FullJson().dump() << '\0' << fixture.binary;
    if (!parts.flush()) {
      std::fprintf(stderr, "gltf_seeds: cannot write to %s\n", argv[1]);
      return 1;
    }
  }
  return 0;
}
