// Writes the map of small_hills.hpp as a bundle, for the tests that start programs, and prints
// start and goal of its flight: LAT,LON LAT,LON. With --observers the map has its named observers.
#include <cstdio>
#include <filesystem>
#include <string_view>
#include <vector>

#include "base/angles.hpp"
#include "map/map_bundle.hpp"
#include "services/small_hills.hpp"

int main(int argc, char** argv) {
  const bool is_watched = argc == 3 && std::string_view(argv[2]) == "--observers";
  if (argc != 2 && !is_watched) {
    std::fprintf(stderr, "usage: small_hills_map FOLDER [--observers]\n");
    return 2;
  }
  const hedgehop::map::Map map = hedgehop::test::small_hills();
  std::filesystem::create_directory(argv[1]);
  hedgehop::map::write_map_bundle(map, R"({"inputs": []})", argv[1]);
  if (is_watched) {
    const hedgehop::map::Map watched = hedgehop::test::watched_hills();
    std::vector<hedgehop::map::NamedBand> bands;
    for (const hedgehop::map::HeightLayer& threat : watched.threats) {
      bands.push_back({threat.name, &threat.height_m});
    }
    hedgehop::map::write_height_bands(map, bands,
                                      std::filesystem::path(argv[1]) / hedgehop::map::kThreatsFile);
  }
  const hedgehop::flight::PlanRequest request = hedgehop::test::across_the_hills(map);
  for (const auto& point : {request.start, request.goal}) {
    std::printf("%.9f,%.9f ", hedgehop::degrees_from_radians(point.position.latitude_rad),
                hedgehop::degrees_from_radians(point.position.longitude_rad));
  }
  std::printf("\n");
  return 0;
}
