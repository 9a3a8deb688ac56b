#include "preparation/burning.hpp"

#include <algorithm>
#include <array>
#include <cpl_error.h>
#include <cpl_string.h>
#include <gdal_alg.h>
#include <gdal_priv.h>
#include <ogr_geometry.h>
#include <stdexcept>

#include "base/errors.hpp"
#include "geo/gdal_guards.hpp"

namespace hedgehop::preparation {
namespace {

// GDAL looks at nothing but the whole call, so stopping is possible between batches only.
constexpr std::size_t kBatch = 256;

// A raster that shares the grid's memory; rows grow northwards as in the grid.
template <typename T>
geo::DatasetPointer shared_dataset(raster::Grid<T>& grid) {
  GDALDriver* memory = GetGDALDriverManager()->GetDriverByName("MEM");
  HEDGEHOP_ASSERT(memory != nullptr);
  geo::DatasetPointer dataset(
      memory->Create("", grid.columns(), grid.rows(), 0, GDT_Unknown, nullptr));
  std::array<char, 64> pointer{};
  pointer[static_cast<std::size_t>(CPLPrintPointer(pointer.data(), grid.values().data(), 63))] =
      '\0';
  CPLStringList options;
  options.SetNameValue("DATAPOINTER", pointer.data());
  HEDGEHOP_ASSERT(dataset && dataset->AddBand(std::is_same_v<T, float> ? GDT_Float32 : GDT_Byte,
                                              options.List()) == CE_None);
  const raster::GridGeometry& g = grid.geometry();
  std::array<double, 6> transform = {g.west_m, g.cell_m, 0.0, g.south_m, 0.0, g.cell_m};
  dataset->SetGeoTransform(transform.data());
  return dataset;
}

template <typename T>
void burn(raster::Grid<T>& grid, const std::vector<BurnItem>& items, Touch touch,
          Observer& observer) {
  if (grid.is_empty() || items.empty()) {
    return;
  }
  const auto dataset = shared_dataset(grid);
  CPLStringList options;
  if (touch == Touch::kAny) {
    options.SetNameValue("ALL_TOUCHED", "TRUE");
  }
  for (std::size_t begin = 0; begin < items.size(); begin += kBatch) {
    observer.check_stop();
    const std::size_t count = std::min(kBatch, items.size() - begin);
    std::vector<OGRGeometryH> geometries(count);
    std::vector<double> values(count);
    for (std::size_t i = 0; i < count; ++i) {
      geometries[i] = OGRGeometry::ToHandle(const_cast<OGRGeometry*>(items[begin + i].geometry));
      values[i] = items[begin + i].value;
    }
    int band = 1;
    const geo::GdalErrors errors;
    const CPLErr result = GDALRasterizeGeometries(
        GDALDataset::ToHandle(dataset.get()), 1, &band, static_cast<int>(count), geometries.data(),
        nullptr, nullptr, values.data(), options.List(), nullptr, nullptr);
    if (result != CE_None) {
      throw std::runtime_error("rasterising failed: " + errors.first());
    }
  }
  dataset->FlushCache(false);
}

}  // namespace

void GeometryDeleter::operator()(OGRGeometry* geometry) const {
  OGRGeometryFactory::destroyGeometry(geometry);
}

GeometryPointer geometry_of(const std::vector<map_sources::MapPolygon>& polygons) {
  const auto ring_of = [](const map_sources::MapLine& line) {
    auto* ring = new OGRLinearRing;
    ring->setNumPoints(static_cast<int>(line.size()), FALSE);
    for (std::size_t i = 0; i < line.size(); ++i) {
      ring->setPoint(static_cast<int>(i), line[i].x_m, line[i].y_m);
    }
    ring->closeRings();
    return ring;
  };
  auto result = std::make_unique<OGRMultiPolygon>();
  for (const map_sources::MapPolygon& polygon : polygons) {
    auto part = std::make_unique<OGRPolygon>();
    part->addRingDirectly(ring_of(polygon.outer));
    for (const map_sources::MapLine& hole : polygon.holes) {
      part->addRingDirectly(ring_of(hole));
    }
    result->addGeometryDirectly(part.release());
  }
  return GeometryPointer(result.release());
}

GeometryPointer geometry_of(const map_sources::MapLine& vertices) {
  if (vertices.size() == 1) {
    return GeometryPointer(new OGRPoint(vertices.front().x_m, vertices.front().y_m));
  }
  auto line = std::make_unique<OGRLineString>();
  for (const geo::MapPoint& point : vertices) {
    line->addPoint(point.x_m, point.y_m);
  }
  return GeometryPointer(line.release());
}

void burn_greatest(raster::Grid<float>& grid, std::vector<BurnItem> items, Touch touch,
                   Observer& observer, raster::Grid<std::uint8_t>* marks) {
  std::stable_sort(items.begin(), items.end(),
                   [](const BurnItem& a, const BurnItem& b) { return a.value < b.value; });
  burn(grid, items, touch, observer);
  if (marks != nullptr) {
    for (BurnItem& item : items) {
      item.value = item.mark;
    }
    burn(*marks, items, touch, observer);
  }
}

void burn_bit(raster::Grid<std::uint16_t>& grid, const std::vector<const OGRGeometry*>& geometries,
              std::uint16_t bit, Touch touch, Observer& observer) {
  raster::Grid<std::uint8_t> mask(grid.geometry(), 0);
  std::vector<BurnItem> items;
  items.reserve(geometries.size());
  for (const OGRGeometry* geometry : geometries) {
    items.push_back({geometry, 1.0});
  }
  burn(mask, items, touch, observer);
  for (std::size_t i = 0; i < mask.values().size(); ++i) {
    if (mask.values()[i] != 0) {
      grid.values()[i] = static_cast<std::uint16_t>(grid.values()[i] | bit);
    }
  }
}

}  // namespace hedgehop::preparation
