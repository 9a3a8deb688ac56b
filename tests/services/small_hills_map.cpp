// Writes the map of small_hills.hpp as a bundle, for the tests that start programs, and prints
// start and goal of its flight: LAT,LON LAT,LON.
#include <cstdio>
#include <filesystem>

#include "base/angles.hpp"
#include "map/map_bundle.hpp"
#include "services/small_hills.hpp"

int main(int argc, char** argv) {
  if (argc != 2) {
    std::fprintf(stderr, "usage: small_hills_map FOLDER\n");
    return 2;
  }
  const hedgehop::map::Map map = hedgehop::test::small_hills();
  std::filesystem::create_directory(argv[1]);
  hedgehop::map::write_map_bundle(map, R"({"inputs": []})", argv[1]);
  const hedgehop::flight::PlanRequest request = hedgehop::test::across_the_hills(map);
  for (const auto& point : {request.start, request.goal}) {
    std::printf("%.9f,%.9f ", hedgehop::degrees_from_radians(point.position.latitude_rad),
                hedgehop::degrees_from_radians(point.position.longitude_rad));
  }
  std::printf("\n");
  return 0;
}
