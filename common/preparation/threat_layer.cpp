#include "preparation/threat_layer.hpp"

#include <algorithm>
#include <atomic>
#include <cmath>
#include <limits>
#include <tbb/info.h>
#include <tbb/parallel_for.h>
#include <tbb/task_arena.h>

namespace hedgehop::preparation {
namespace {

constexpr float kNaN = std::numeric_limits<float>::quiet_NaN();

// Steepest slope from the eye to what stands between it and the target, both in cells.
double steepest_between(const raster::Grid<float>& opaque_m, double x0, double y0, double x1,
                        double y1, double eye_m, double drop_1pm) {
  const double cell_m = opaque_m.geometry().cell_m;
  const bool is_along_x = std::fabs(x1 - x0) >= std::fabs(y1 - y0);
  const double along0 = is_along_x ? x0 : y0;
  const double along1 = is_along_x ? x1 : y1;
  const double across0 = is_along_x ? y0 : x0;
  const double across1 = is_along_x ? y1 : x1;
  const double length = std::fabs(along1 - along0);
  double steepest = -std::numeric_limits<double>::infinity();
  if (!(length > 0.0)) {
    return steepest;
  }
  const double distance_m = cell_m * std::sqrt((x1 - x0) * (x1 - x0) + (y1 - y0) * (y1 - y0));
  const int first = static_cast<int>(std::floor(std::min(along0, along1))) + 1;
  const int last = static_cast<int>(std::ceil(std::max(along0, along1))) - 1;
  for (int i = first; i <= last; ++i) {
    const double t = (i - along0) / (along1 - along0);
    const double across = across0 + t * (across1 - across0);
    const double low = std::floor(across);
    const double fraction = across - low;
    const int j = static_cast<int>(low);
    const raster::CellIndex a = is_along_x ? raster::CellIndex{i, j} : raster::CellIndex{j, i};
    const raster::CellIndex b =
        is_along_x ? raster::CellIndex{i, j + 1} : raster::CellIndex{j + 1, i};
    const raster::GridGeometry& g = opaque_m.geometry();
    double z_m = g.contains(a) ? static_cast<double>(opaque_m.at(a))
                               : std::numeric_limits<double>::quiet_NaN();
    if (fraction > 0.0) {
      const double next_m = g.contains(b) ? static_cast<double>(opaque_m.at(b))
                                          : std::numeric_limits<double>::quiet_NaN();
      z_m += fraction * (next_m - z_m);
    }
    const double d_m = t * distance_m;
    const double slope = (z_m - drop_1pm * d_m * d_m - eye_m) / d_m;
    if (slope > steepest) {  // not for NaN
      steepest = slope;
    }
  }
  return steepest;
}

}  // namespace

std::vector<NamedObserver> read_named_observers(ConfigReader& reader) {
  std::vector<NamedObserver> observers;
  for (ConfigReader& entry : reader.required_sections("observers")) {
    NamedObserver observer;
    observer.name = entry.required_string("name");
    entry.require(!observer.name.empty(), "name", "must not be empty");
    for (const NamedObserver& other : observers) {
      entry.require(other.name != observer.name, "name", "is given to another observer too");
    }
    constexpr double kQuarterTurn_rad = 1.5707963267948966;
    observer.position.latitude_rad = entry.required_angle("latitude_deg");
    entry.require(std::fabs(observer.position.latitude_rad) <= kQuarterTurn_rad, "latitude_deg",
                  "must lie in -90 to 90");
    observer.position.longitude_rad = entry.required_angle("longitude_deg");
    entry.require(std::fabs(observer.position.longitude_rad) <= 2.0 * kQuarterTurn_rad,
                  "longitude_deg", "must lie in -180 to 180");
    observer.mast_height_m = entry.required_double("mast_height_m");
    entry.require(observer.mast_height_m >= 0.0 && observer.mast_height_m <= 10000.0,
                  "mast_height_m", "must lie in 0 to 10000");
    observer.range_m = entry.required_double("range_m");
    entry.require(observer.range_m > 0.0 && observer.range_m <= 200000.0, "range_m",
                  "must be above 0 and at most 200000");
    entry.finish();
    observers.push_back(std::move(observer));
  }
  reader.finish();
  return observers;
}

raster::Grid<float> lowest_seen_height(const VisibilityGround& ground,
                                       const raster::Grid<float>& terrain_m,
                                       const geo::MapPoint& place, double mast_height_m,
                                       double range_m, double drop_1pm, int threads,
                                       Observer& observer) {
  const raster::GridGeometry& g = ground.surface_m.geometry();
  raster::Grid<float> result(g, kNaN);
  if (!g.contains(place) || std::isnan(terrain_m.at(g.cell_at(place)))) {
    return result;
  }
  const double eye_m = static_cast<double>(terrain_m.at(g.cell_at(place))) + mast_height_m;
  // In cells, centres at whole numbers.
  const double x0 = (place.x_m - g.west_m) / g.cell_m - 0.5;
  const double y0 = (place.y_m - g.south_m) / g.cell_m - 0.5;
  const double range = range_m / g.cell_m;
  const int row_begin = std::max(0, static_cast<int>(std::ceil(y0 - range)));
  const int row_end = std::min(g.rows, static_cast<int>(std::floor(y0 + range)) + 1);
  std::atomic<int> rows_done = 0;
  const int processors = tbb::info::default_concurrency();
  tbb::task_arena arena(threads > 0 ? std::min(threads, processors) : processors);
  arena.execute([&] {
    tbb::parallel_for(row_begin, std::max(row_begin, row_end), [&](int row) {
      observer.check_stop();
      for (int column = 0; column < g.columns; ++column) {
        const double dx = column - x0;
        const double dy = row - y0;
        const double d_m = g.cell_m * std::sqrt(dx * dx + dy * dy);
        const double surface_m = static_cast<double>(ground.surface_m.at(column, row));
        if (!(d_m <= range_m) || std::isnan(surface_m)) {
          continue;
        }
        const double steepest =
            steepest_between(ground.opaque_m, x0, y0, column, row, eye_m, drop_1pm);
        const double lowest_m =
            std::isinf(steepest) ? 0.0 : eye_m + steepest * d_m + drop_1pm * d_m * d_m - surface_m;
        result.at(column, row) = static_cast<float>(std::max(lowest_m, 0.0));
      }
      observer.progress("observers", ++rows_done, row_end - row_begin);
    });
  });
  return result;
}

}  // namespace hedgehop::preparation
