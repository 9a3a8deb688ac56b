#include "geo/vertical_datum.hpp"

#include <algorithm>
#include <array>
#include <charconv>
#include <cmath>
#include <limits>
#include <proj.h>

#include "base/angles.hpp"
#include "base/errors.hpp"

namespace hedgehop::geo {
namespace {

struct ContextCloser {
  void operator()(PJ_CONTEXT* context) const { proj_context_destroy(context); }
};
using ContextPointer = std::unique_ptr<PJ_CONTEXT, ContextCloser>;
struct ObjectCloser {
  void operator()(PJ* object) const { proj_destroy(object); }
};
using ObjectPointer = std::unique_ptr<PJ, ObjectCloser>;
struct ListCloser {
  void operator()(PJ_OBJ_LIST* list) const { proj_list_destroy(list); }
};
struct FactoryCloser {
  void operator()(PJ_OPERATION_FACTORY_CONTEXT* factory) const {
    proj_operation_factory_context_destroy(factory);
  }
};

struct KnownDatum {
  const char* name;
  int epsg_code;
};
constexpr std::array<KnownDatum, 4> kKnown = {
    {{"EGM96", 5773}, {"EGM2008", 3855}, {"EGM84", 5798}, {"ellipsoid", 0}}};
constexpr int kGeodetic3d = 4979;

ContextPointer quiet_context() {
  ContextPointer context(proj_context_create());
  HEDGEHOP_ASSERT(context != nullptr);
  proj_log_level(context.get(), PJ_LOG_NONE);
  proj_context_set_enable_network(context.get(), 0);
  return context;
}

char small(char c) { return c >= 'A' && c <= 'Z' ? static_cast<char>(c - 'A' + 'a') : c; }

bool same_word(std::string_view a, std::string_view b) {
  return std::equal(a.begin(), a.end(), b.begin(), b.end(),
                    [](char x, char y) { return small(x) == small(y); });
}

bool is_vertical(int epsg_code) {
  const ContextPointer context = quiet_context();
  const ObjectPointer object(proj_create_from_database(
      context.get(), "EPSG", std::to_string(epsg_code).c_str(), PJ_CATEGORY_CRS, 0, nullptr));
  return object && proj_get_type(object.get()) == PJ_TYPE_VERTICAL_CRS;
}

std::string code_with_position(const VerticalDatum& datum) {
  return datum.epsg_code == 0 ? "EPSG:4979" : "EPSG:4326+" + std::to_string(datum.epsg_code);
}

// Metres in one unit of the datum's heights.
double unit_of_m(PJ_CONTEXT* context, const VerticalDatum& datum) {
  double unit_m = 1.0;
  if (datum.epsg_code != 0) {
    const ObjectPointer crs(proj_create_from_database(
        context, "EPSG", std::to_string(datum.epsg_code).c_str(), PJ_CATEGORY_CRS, 0, nullptr));
    const ObjectPointer axes(crs ? proj_crs_get_coordinate_system(context, crs.get()) : nullptr);
    if (axes) {
      proj_cs_get_axis_info(context, axes.get(), 0, nullptr, nullptr, nullptr, &unit_m, nullptr,
                            nullptr, nullptr);
    }
  }
  return unit_m;
}

// Grids of an operation that are not installed, and the folders where PROJ looks.
std::string missing_grids(PJ_CONTEXT* context, const PJ* operation) {
  std::string names;
  for (int i = 0; i < proj_coordoperation_get_grid_used_count(context, operation); ++i) {
    const char* short_name = nullptr;
    int is_available = 0;
    if (proj_coordoperation_get_grid_used(context, operation, i, &short_name, nullptr, nullptr,
                                          nullptr, nullptr, nullptr, &is_available) != 0 &&
        is_available == 0 && short_name != nullptr) {
      names += (names.empty() ? "" : ", ") + std::string(short_name);
    }
  }
  return names;
}

std::string search_folders(PJ_CONTEXT* context) {
  // The list stands in PROJ's own separator.
  const char* paths = proj_context_get_database_path(context);
  const std::string database = paths == nullptr ? "" : paths;
  const std::size_t slash = database.rfind('/');
  return slash == std::string::npos ? "PROJ's data folder" : database.substr(0, slash);
}

}  // namespace

VerticalDatum VerticalDatum::parse(std::string_view text) {
  for (const KnownDatum& known : kKnown) {
    if (same_word(text, known.name)) {
      return {known.name, known.epsg_code};
    }
  }
  constexpr std::string_view kPrefix = "EPSG:";
  int code = 0;
  if (text.size() > kPrefix.size() && same_word(text.substr(0, kPrefix.size()), kPrefix)) {
    const std::string_view digits = text.substr(kPrefix.size());
    const auto [end, error] = std::from_chars(digits.data(), digits.data() + digits.size(), code);
    if (error == std::errc() && end == digits.data() + digits.size()) {
      for (const KnownDatum& known : kKnown) {
        if (code == known.epsg_code && code != 0) {
          return {known.name, code};
        }
      }
      if (code == kGeodetic3d) {
        return {"ellipsoid", 0};
      }
      if (code > 0 && is_vertical(code)) {
        return {"EPSG:" + std::to_string(code), code};
      }
    }
  }
  throw UsageError("vertical datum '" + std::string(text.substr(0, 60)) + "' is not known",
                   "give EGM96, EGM2008, EGM84, ellipsoid, or the code of a vertical coordinate "
                   "system, for example EPSG:5703");
}

struct VerticalShift::Impl {
  ContextPointer context;
  ObjectPointer transformation;
  std::string operation;
  double to_unit_m = 1.0;
};

VerticalShift::VerticalShift(const VerticalDatum& from, const VerticalDatum& to,
                             const GeodeticBox& area)
    : impl_(std::make_unique<Impl>()) {
  impl_->context = quiet_context();
  PJ_CONTEXT* context = impl_->context.get();
  impl_->to_unit_m = unit_of_m(context, to);
  const ObjectPointer source(proj_create(context, code_with_position(from).c_str()));
  const ObjectPointer target(proj_create(context, code_with_position(to).c_str()));
  HEDGEHOP_ASSERT(source && target);
  const std::unique_ptr<PJ_OPERATION_FACTORY_CONTEXT, FactoryCloser> factory(
      proj_create_operation_factory_context(context, nullptr));
  proj_operation_factory_context_set_area_of_interest(
      context, factory.get(), degrees_from_radians(area.west_rad),
      degrees_from_radians(area.south_rad), degrees_from_radians(area.east_rad),
      degrees_from_radians(area.north_rad));
  proj_operation_factory_context_set_spatial_criterion(context, factory.get(),
                                                       PROJ_SPATIAL_CRITERION_PARTIAL_INTERSECTION);
  // Operations without their grids are wanted too: to name the grids.
  proj_operation_factory_context_set_grid_availability_use(context, factory.get(),
                                                           PROJ_GRID_AVAILABILITY_IGNORED);
  proj_operation_factory_context_set_allow_ballpark_transformations(context, factory.get(), 0);
  const std::unique_ptr<PJ_OBJ_LIST, ListCloser> operations(
      proj_create_operations(context, source.get(), target.get(), factory.get()));
  const int count = operations ? proj_list_get_count(operations.get()) : 0;
  std::string missing;
  for (int i = 0; i < count; ++i) {
    ObjectPointer operation(proj_list_get(context, operations.get(), i));
    if (!operation) {
      continue;
    }
    const std::string grids = missing_grids(context, operation.get());
    if (proj_coordoperation_is_instantiable(context, operation.get()) == 0 || !grids.empty()) {
      missing = missing.empty() ? grids : missing;
      continue;
    }
    const char* name = proj_get_name(operation.get());
    impl_->operation = name == nullptr ? "" : name;
    impl_->transformation.reset(proj_normalize_for_visualization(context, operation.get()));
    if (impl_->transformation) {
      return;
    }
  }
  const std::string what = "heights in " + from.name + " cannot be converted to " + to.name;
  if (missing.empty()) {
    throw DataError(what + ": PROJ knows no way for this region",
                    "convert the file first, or name another datum for it");
  }
  throw DataError(what + ": the grid " + missing + " is not installed",
                  "fetch it from the PROJ data collection and put it into " +
                      search_folders(context) + ", or say what else the heights refer to, " +
                      "for example FILE:datum=" + to.name +
                      " (EGM96 and EGM2008 differ by 1 to 2 m)");
}

VerticalShift::~VerticalShift() = default;
VerticalShift::VerticalShift(VerticalShift&&) noexcept = default;
VerticalShift& VerticalShift::operator=(VerticalShift&&) noexcept = default;

double VerticalShift::at_m(const GeodeticPosition& position) const {
  const PJ_COORD from = proj_coord(degrees_from_radians(position.longitude_rad),
                                   degrees_from_radians(position.latitude_rad), 0.0, 0.0);
  proj_errno_reset(impl_->transformation.get());
  const PJ_COORD to = proj_trans(impl_->transformation.get(), PJ_FWD, from);
  const double shift_m = to.xyz.z * impl_->to_unit_m;
  // HUGE_VAL stands for a failure; no geoid is further than 200 m from the ellipsoid.
  if (proj_errno(impl_->transformation.get()) != 0 || !(std::fabs(shift_m) < 500.0)) {
    return std::numeric_limits<double>::quiet_NaN();
  }
  return std::round(shift_m * 1024.0) / 1024.0;
}

const std::string& VerticalShift::operation() const { return impl_->operation; }

}  // namespace hedgehop::geo
