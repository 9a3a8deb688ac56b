#include "synthetic_map.hpp"

#include <utility>

#include "base/shipped_config.hpp"
#include "map/map_bundle.hpp"
#include "map/source_layer.hpp"
#include "preparation/prepare.hpp"

namespace hedgehop::cli {

map::Map prepare_synthetic_map(const map_sources::SyntheticRegion& region,
                               const std::filesystem::path& folder, std::optional<double> cell_m,
                               int threads, Observer& observer) {
  ConfigReader reader =
      ConfigReader::from_text(shipped_config("prepare.yaml"), "config/prepare.yaml");
  const auto options = preparation::PrepareOptions::read(reader);
  preparation::PrepareRequest request;
  request.dem_files = {region.dem_file};
  request.osm_files = {region.osm_file};
  request.extent = region.extent;
  request.cell_m = cell_m;
  request.crs = region.crs;
  request.label = region.label;
  request.attributions = {region.attribution};
  request.threads = threads;
  preparation::PreparedMap prepared = preparation::prepare(request, options, observer);
  std::filesystem::create_directory(folder);
  map::write_map_bundle(prepared.map, prepared.provenance_json, folder);
  map::write_source_layer(prepared.map, prepared.sources, folder);
  return std::move(prepared.map);
}

}  // namespace hedgehop::cli
