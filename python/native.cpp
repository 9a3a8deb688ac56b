// Maps, preparation, plans and their verification for Python.
#include "native.hpp"

#include <algorithm>
#include <atomic>
#include <exception>
#include <memory>
#include <mutex>
#include <optional>
#include <pybind11/functional.h>
#include <pybind11/numpy.h>
#include <pybind11/stl.h>
#include <tbb/global_control.h>

#include "base/angles.hpp"
#include "base/files.hpp"
#include "base/shipped_config.hpp"
#include "geo/map_projection.hpp"
#include "map/map_bundle.hpp"
#include "map/source_layer.hpp"
#include "map_sources/synthetic_region.hpp"
#include "messages/message_error.hpp"
#include "output/plan_bundle.hpp"
#include "planning/planning.hpp"
#include "planning/request_areas.hpp"
#include "preparation/prepare.hpp"
#include "verification/plan_check.hpp"

namespace py = pybind11;

namespace hedgehop::python {
namespace {

using MapPointer = std::shared_ptr<map::Map>;

// --- errors ------------------------------------------------------------------------------------

// As long as the interpreter lives, and not taken apart after it.
PyObject *g_user_error, *g_usage_error, *g_config_error, *g_data_error, *g_system_failure,
    *g_bus_error, *g_interrupted, *g_message_error;

void raise(PyObject* type, const UserError& error) {
  const py::object raised = py::handle(type)(error.what());
  raised.attr("hint") = error.hint();
  raised.attr("exit_code") = static_cast<int>(error.code());
  PyErr_SetObject(type, raised.ptr());
}

void add_errors(py::module_& module) {
  const auto add = [&](const char* name, PyObject* base, const char* text, int code) {
    const std::string full = std::string("hedgehop.") + name;
    py::dict members;
    members["__doc__"] = text;
    members["hint"] = "";
    members["exit_code"] = code;
    PyObject* type = PyErr_NewException(full.c_str(), base, members.ptr());
    module.attr(name) = py::handle(type);
    return type;
  };
  const auto code = [](ExitCode value) { return static_cast<int>(value); };
  g_user_error = add("UserError", PyExc_Exception,
                     "What a user can mend. `hint` says how; `exit_code` is that of the programs.",
                     code(ExitCode::kFailure));
  g_usage_error = add("UsageError", g_user_error, "Something is asked for that cannot be meant.",
                      code(ExitCode::kUsage));
  g_config_error =
      add("ConfigError", g_user_error, "A configuration is wrong.", code(ExitCode::kUsage));
  g_data_error =
      add("DataError", g_user_error, "A file is missing, damaged or does not hold what is needed.",
          code(ExitCode::kBadData));
  g_system_failure =
      add("SystemFailure", g_user_error, "The system refused something, a full disk for example.",
          code(ExitCode::kFailure));
  g_bus_error =
      add("BusError", g_user_error, "The bus cannot be reached.", code(ExitCode::kBusUnreachable));
  g_interrupted =
      add("Interrupted", g_user_error, "The caller asked to stop.", code(ExitCode::kInterrupted));
  g_message_error = add("MessageError", g_data_error,
                        "A message that is not what its type promises.", code(ExitCode::kBadData));
  py::register_exception_translator([](std::exception_ptr thrown) {
    try {
      if (thrown) {
        std::rethrow_exception(thrown);
      }
    } catch (const UsageError& error) {
      raise(g_usage_error, error);
    } catch (const ConfigError& error) {
      raise(g_config_error, error);
    } catch (const DataError& error) {
      raise(g_data_error, error);
    } catch (const SystemFailure& error) {
      raise(g_system_failure, error);
    } catch (const BusError& error) {
      raise(g_bus_error, error);
    } catch (const Interrupted& error) {
      raise(g_interrupted, error);
    } catch (const UserError& error) {
      raise(g_user_error, error);
    } catch (const messages::MessageError& error) {
      PyErr_SetString(g_message_error, error.what());
    }
  });
}

// --- progress ----------------------------------------------------------------------------------

using OnProgress = std::function<py::object(const std::string&, double)>;

// Tells a Python function how far the work is, from whatever thread, at most every 1 % of a stage;
// False or an exception of it, and Ctrl-C, stop the work.
class PythonObserver final : public Observer {
 public:
  explicit PythonObserver(OnProgress on_progress)
      : on_progress_(std::move(on_progress)), python_thread_(PyThread_get_thread_ident()) {}

  void progress(std::string_view stage, double done, double total) override {
    {
      const std::lock_guard lock(mutex_);
      const int percent = total > 0.0 ? static_cast<int>(100.0 * std::min(done / total, 1.0)) : 0;
      if (stage == stage_ && percent <= percent_) {
        return;
      }
      stage_ = stage;
      percent_ = percent;
    }
    const py::gil_scoped_acquire lock;
    if (is_stopped_) {
      return;
    }
    try {
      if (PyThread_get_thread_ident() == python_thread_ && PyErr_CheckSignals() != 0) {
        throw py::error_already_set();
      }
      if (on_progress_) {
        const py::object answer =
            on_progress_(std::string(stage), total > 0.0 ? done / total : 0.0);
        is_stopped_ = answer.is(py::bool_(false));
      }
    } catch (py::error_already_set& error) {
      error_ = std::make_unique<py::error_already_set>(std::move(error));
      is_stopped_ = true;
    }
  }

  void note(std::string_view) override {}

  [[nodiscard]] bool stop_requested() const override { return is_stopped_; }

  // With the lock of Python: what the function threw.
  void rethrow() {
    if (error_) {
      throw py::error_already_set(*std::exchange(error_, nullptr));
    }
  }

 private:
  OnProgress on_progress_;
  unsigned long python_thread_;
  std::mutex mutex_;
  std::string stage_;
  int percent_ = -1;
  std::atomic<bool> is_stopped_ = false;
  std::unique_ptr<py::error_already_set> error_;
};

// Works without the lock of Python; an exception of the progress function comes before that of the
// work that it stopped.
template <typename Work>
auto work_with(OnProgress on_progress, int threads, const Work& work) {
  if (threads < 0 || threads > 1024) {
    throw UsageError("threads is " + std::to_string(threads) + ", must be from 1 to 1024",
                     "0 means as many as the machine has");
  }
  PythonObserver observer(std::move(on_progress));
  std::exception_ptr failure;
  std::optional<decltype(work(observer))> result;
  {
    const py::gil_scoped_release released;
    std::optional<tbb::global_control> control;
    if (threads > 0) {
      control.emplace(tbb::global_control::max_allowed_parallelism,
                      static_cast<std::size_t>(threads));
    }
    try {
      result.emplace(work(observer));
    } catch (...) {
      failure = std::current_exception();
    }
  }
  observer.rethrow();
  if (failure) {
    std::rethrow_exception(failure);
  }
  if (observer.stop_requested()) {
    throw Interrupted();
  }
  return std::move(*result);
}

// --- maps --------------------------------------------------------------------------------------

// The values where they are: nothing is copied, nothing can be written, the map stays as long as
// the array.
template <typename T>
py::array layer_view(const MapPointer& map, const raster::Grid<T>& grid) {
  const auto rows = static_cast<py::ssize_t>(grid.rows());
  const auto columns = static_cast<py::ssize_t>(grid.columns());
  py::array_t<T> array({rows, columns}, grid.values().data(), py::cast(map));
  array.attr("flags").attr("writeable") = false;
  return array;
}

py::array visibility_share(const map::Map& map) {
  py::array_t<float> array({map.geometry.rows, map.geometry.columns});
  float* to = array.mutable_data();
  for (const std::uint16_t stored : map.visibility.values()) {
    *to++ = static_cast<float>(map::visibility_share(stored));
  }
  return array;
}

py::tuple degrees_of(const geo::GeodeticPosition& position) {
  return py::make_tuple(degrees_from_radians(position.latitude_rad),
                        degrees_from_radians(position.longitude_rad));
}

geo::GeodeticPosition position_of(double latitude_deg, double longitude_deg) {
  if (!(latitude_deg >= -90.0 && latitude_deg <= 90.0) ||
      !(longitude_deg >= -180.0 && longitude_deg <= 180.0)) {
    throw UsageError(
        "(" + std::to_string(latitude_deg) + ", " + std::to_string(longitude_deg) + ") is no place",
        "give latitude and longitude in degrees, in this order");
  }
  return {radians_from_degrees(latitude_deg), radians_from_degrees(longitude_deg)};
}

MapPointer prepare_map(const std::vector<std::string>& dem, const std::vector<std::string>& osm,
                       const std::string& out, const std::optional<std::vector<double>>& bbox_deg,
                       std::optional<double> cell_m, const std::string& crs,
                       const std::string& label, const std::vector<std::string>& attributions,
                       const std::vector<std::string>& obstacles,
                       const std::vector<std::string>& areas, const std::string& config_file,
                       const std::vector<std::string>& settings, bool overwrite, int threads,
                       OnProgress progress) {
  constexpr char kShipped[] = "config/prepare.yaml";
  std::string text(shipped_config("prepare.yaml"));
  if (!config_file.empty()) {
    text = overlay_config(text, kShipped, read_file(config_file), config_file);
  }
  for (const std::string& setting : settings) {
    text = set_config_value(text, setting);
  }
  ConfigReader reader =
      ConfigReader::from_text(text, config_file.empty() ? kShipped : "effective configuration");
  const auto options = preparation::PrepareOptions::read(reader);
  preparation::PrepareRequest request;
  for (const std::string& file : dem) {
    request.dem_files.push_back(map_sources::ElevationInput::parse(file));
  }
  request.osm_files.assign(osm.begin(), osm.end());
  if (bbox_deg) {
    if (bbox_deg->size() != 4) {
      throw UsageError(
          "bbox_deg has " + std::to_string(bbox_deg->size()) + " numbers, 4 are wanted",
          "west, south, east, north in degrees");
    }
    const auto side = [&](std::size_t i) { return radians_from_degrees((*bbox_deg)[i]); };
    request.extent = geo::GeodeticBox{side(0), side(1), side(2), side(3)};
  }
  request.cell_m = cell_m;
  request.crs = crs;
  request.label = label;
  request.attributions = attributions;
  request.obstacle_files.assign(obstacles.begin(), obstacles.end());
  request.area_files.assign(areas.begin(), areas.end());
  request.threads = threads;
  return work_with(std::move(progress), threads, [&](Observer& observer) -> MapPointer {
    StagedFolder folder(out, map::kMapManifestFile, overwrite);
    preparation::PreparedMap prepared = preparation::prepare(request, options, observer);
    map::write_map_bundle(prepared.map, prepared.provenance_json, folder.path(), &observer);
    map::write_source_layer(prepared.map, prepared.sources, folder.path());
    observer.check_stop();
    folder.commit();
    return std::make_shared<map::Map>(std::move(prepared.map));
  });
}

void add_maps(py::module_& module) {
  py::class_<map::Map, std::shared_ptr<map::Map>>(module, "Map")
      .def_property_readonly(
          "terrain_m", [](const MapPointer& map) { return layer_view<float>(map, map->terrain_m); })
      .def_property_readonly(
          "surface_m", [](const MapPointer& map) { return layer_view<float>(map, map->surface_m); })
      .def_property_readonly(
          "semantics",
          [](const MapPointer& map) { return layer_view<std::uint16_t>(map, map->semantics); })
      .def_property_readonly(
          "visibility_stored",
          [](const MapPointer& map) { return layer_view<std::uint16_t>(map, map->visibility); })
      .def_property_readonly("visibility", &visibility_share)
      .def_property_readonly("west_m", [](const map::Map& map) { return map.geometry.west_m; })
      .def_property_readonly("south_m", [](const map::Map& map) { return map.geometry.south_m; })
      .def_property_readonly("cell_m", [](const map::Map& map) { return map.geometry.cell_m; })
      .def_property_readonly("columns", [](const map::Map& map) { return map.geometry.columns; })
      .def_property_readonly("rows", [](const map::Map& map) { return map.geometry.rows; })
      .def_readonly("crs_wkt", &map::Map::crs_wkt)
      .def_readonly("vertical_datum", &map::Map::vertical_datum)
      .def_readonly("reference_height_m", &map::Map::reference_height_m)
      .def_readonly("label", &map::Map::label)
      .def_readonly("attributions", &map::Map::attributions)
      .def_property_readonly("hash", [](const map::Map& map) { return map.hash.hex(); })
      .def(
          "to_map",
          [](const map::Map& map, double latitude_deg, double longitude_deg) {
            const geo::MapPoint point =
                geo::MapProjection(map.crs_wkt).to_map(position_of(latitude_deg, longitude_deg));
            return py::make_tuple(point.x_m, point.y_m);
          },
          py::arg("latitude_deg"), py::arg("longitude_deg"))
      .def(
          "to_geodetic",
          [](const map::Map& map, double x_m, double y_m) {
            return degrees_of(geo::MapProjection(map.crs_wkt).to_geodetic({x_m, y_m}));
          },
          py::arg("x_m"), py::arg("y_m"));

  py::dict classes;
  for (const map::SemanticName& name : map::semantic_names()) {
    classes[py::str(std::string(name.name))] = static_cast<int>(name.bit);
  }
  module.attr("SEMANTIC_CLASSES") = classes;
  module.attr("VISIBILITY_UNKNOWN") = static_cast<int>(map::kVisibilityUnknown);

  module.def(
      "read_map",
      [](const std::string& folder) {
        const py::gil_scoped_release released;
        return std::make_shared<map::Map>(map::read_map_bundle(folder));
      },
      py::arg("folder"));
  module.def(
      "write_synthetic_region",
      [](const std::string& folder, std::uint64_t seed) {
        map_sources::SyntheticRegion region;
        {
          const py::gil_scoped_release released;
          region = map_sources::write_synthetic_region(folder, {.seed = seed});
        }
        py::dict result;
        result["dem_file"] = region.dem_file.string();
        result["osm_file"] = region.osm_file.string();
        result["label"] = region.label;
        result["attribution"] = region.attribution;
        result["crs"] = region.crs;
        result["bbox_deg"] = py::make_tuple(degrees_from_radians(region.extent.west_rad),
                                            degrees_from_radians(region.extent.south_rad),
                                            degrees_from_radians(region.extent.east_rad),
                                            degrees_from_radians(region.extent.north_rad));
        result["start"] = degrees_of(region.start);
        result["goal"] = degrees_of(region.goal);
        return result;
      },
      py::arg("folder"), py::arg("seed"));
  module.def("prepare", &prepare_map);
}

// --- plans -------------------------------------------------------------------------------------

using Place = std::tuple<double, double, std::optional<double>>;

flight::RequestPoint point_of(const Place& place) {
  const auto& [latitude_deg, longitude_deg, height_m] = place;
  return {position_of(latitude_deg, longitude_deg), height_m};
}

py::array waypoint_array(const std::vector<flight::Waypoint>& waypoints) {
  py::array_t<double> array({static_cast<py::ssize_t>(waypoints.size()), py::ssize_t{3}});
  double* to = array.mutable_data();
  for (const flight::Waypoint& waypoint : waypoints) {
    *to++ = waypoint.x_m;
    *to++ = waypoint.y_m;
    *to++ = waypoint.altitude_m;
  }
  return array;
}

void write_plan(const flight::Plan& plan, const std::string& out, bool overwrite) {
  const py::gil_scoped_release released;
  StagedFolder folder(out, output::kPlanFile, overwrite);
  output::write_plan_bundle(plan, folder.path());
  folder.commit();
}

std::variant<std::shared_ptr<flight::Plan>, flight::NoPlan> make_plan(
    const MapPointer& map, const Place& start, const Place& goal, const std::vector<Place>& via,
    std::optional<double> start_heading_deg, std::optional<double> speed_mps, std::uint64_t seed,
    std::int64_t work, const std::string& config_file, const std::vector<std::string>& settings,
    int threads, OnProgress progress) {
  flight::PlanRequest request;
  request.start = point_of(start);
  request.goal = point_of(goal);
  for (const Place& place : via) {
    request.via.push_back(point_of(place));
  }
  if (start_heading_deg) {
    request.start_heading_true_rad = wrap_to_two_pi(radians_from_degrees(*start_heading_deg));
  }
  request.speed_mps = speed_mps;
  request.seed = seed;
  if (work < 0) {
    throw UsageError("work is " + std::to_string(work) + ", must not be negative",
                     "0 means that of the configuration");
  }
  request.work_budget = work;
  const planning::PlanningConfig config = planning::read_planning_config(
      planning::effective_planning_config(config_file, settings), "effective configuration");
  auto answer = work_with(std::move(progress), threads, [&](Observer& observer) {
    return planning::plan(
        *map, request, config,
        [&](const global_planning::RouteProgress& at) {
          observer.progress("planning the route", static_cast<double>(at.work_units),
                            static_cast<double>(at.work_budget));
        },
        observer);
  });
  if (auto* none = std::get_if<flight::NoPlan>(&answer)) {
    return std::move(*none);
  }
  return std::make_shared<flight::Plan>(std::move(std::get<flight::Plan>(answer)));
}

flight::Verdict verify_plan(const MapPointer& map, const std::string& folder) {
  const py::gil_scoped_release released;
  const flight::Plan plan = output::read_plan_bundle(folder);
  return verification::check_plan(
             planning::map_of_plan(*map, plan, folder, "this"), plan,
             read_file(std::filesystem::path(folder) / output::kTrajectoryFile))
      .verdict;
}

void add_plans(py::module_& module) {
  PYBIND11_NUMPY_DTYPE(flight::FlightState, time_s, x_m, y_m, altitude_m, speed_mps,
                       heading_true_rad, convergence_rad, bank_rad, roll_rate_radps, pitch_rad,
                       pitch_rate_radps, climb_rate_mps, vertical_acceleration_mps2,
                       target_heading_true_rad, commanded_heading_true_rad,
                       commanded_climb_angle_rad, commanded_speed_mps, surface_m, terrain_m);

  py::class_<flight::Violation>(module, "Violation")
      .def_readonly("rule", &flight::Violation::rule)
      .def_readonly("time_s", &flight::Violation::time_s)
      .def_property_readonly("x_m", [](const flight::Violation& v) { return v.place.x_m; })
      .def_property_readonly("y_m", [](const flight::Violation& v) { return v.place.y_m; })
      .def_readonly("value", &flight::Violation::value)
      .def_readonly("limit", &flight::Violation::limit)
      .def_property_readonly("unit", [](const flight::Violation& v) {
        return std::string(verification::unit_of(v.rule));
      });
  py::class_<flight::Verdict>(module, "Verdict")
      .def_readonly("is_verified", &flight::Verdict::is_verified)
      .def_readonly("violation_count", &flight::Verdict::violation_count)
      .def_readonly("violations", &flight::Verdict::violations)
      .def_readonly("clearance_min_m", &flight::Verdict::clearance_min_m)
      .def_readonly("bank_max_rad", &flight::Verdict::bank_max_rad)
      .def_readonly("roll_rate_max_radps", &flight::Verdict::roll_rate_max_radps)
      .def_readonly("climb_rate_max_mps", &flight::Verdict::climb_rate_max_mps)
      .def_readonly("descent_rate_max_mps", &flight::Verdict::descent_rate_max_mps)
      .def_readonly("speed_min_mps", &flight::Verdict::speed_min_mps)
      .def_readonly("speed_max_mps", &flight::Verdict::speed_max_mps)
      .def_readonly("share_under_ceiling", &flight::Verdict::share_under_ceiling)
      .def_readonly("goal_distance_m", &flight::Verdict::goal_distance_m);
  py::class_<flight::NoPlan>(module, "NoPlan")
      .def_property_readonly("cause",
                             [](const flight::NoPlan& none) { return flight::name_of(none.cause); })
      .def_readonly("explanation", &flight::NoPlan::explanation)
      .def_property_readonly("place",
                             [](const flight::NoPlan& none) -> py::object {
                               if (!none.place) {
                                 return py::none();
                               }
                               return py::make_tuple(none.place->x_m, none.place->y_m);
                             })
      .def("__bool__", [](const flight::NoPlan&) { return false; })
      .def("__repr__", [](const flight::NoPlan& none) {
        return std::string("NoPlan(") + flight::name_of(none.cause) + ": " + none.explanation + ")";
      });
  py::class_<flight::Plan, std::shared_ptr<flight::Plan>>(module, "Plan")
      .def_property_readonly(
          "request_id", [](const flight::Plan& plan) { return plan.route_plan.request_id.hex(); })
      .def_property_readonly(
          "map_hash", [](const flight::Plan& plan) { return plan.route_plan.map.hash.hex(); })
      .def_property_readonly("verdict", [](const flight::Plan& plan) { return plan.verdict; })
      .def_readonly("warnings", &flight::Plan::warnings)
      .def_property_readonly("length_m",
                             [](const flight::Plan& plan) { return plan.measures.length_m; })
      .def_property_readonly("duration_s",
                             [](const flight::Plan& plan) { return plan.measures.duration_s; })
      .def_property_readonly("mean_height_m",
                             [](const flight::Plan& plan) { return plan.measures.mean_height_m; })
      .def_property_readonly("visibility_m",
                             [](const flight::Plan& plan) { return plan.measures.visibility_m; })
      .def_property_readonly("semantics_m",
                             [](const flight::Plan& plan) { return plan.measures.semantics_m; })
      .def_property_readonly(
          "route_cost_m",
          [](const flight::Plan& plan) { return plan.route_plan.route.cost.total_m(); })
      .def_property_readonly(
          "lower_bound_m",
          [](const flight::Plan& plan) { return plan.route_plan.route.lower_bound_m; })
      .def_property_readonly("config_text",
                             [](const flight::Plan& plan) { return plan.route_plan.config_text; })
      .def_property_readonly(
          "waypoints",
          [](const flight::Plan& plan) { return waypoint_array(plan.route_plan.route.waypoints); })
      .def_property_readonly("states",
                             [](const std::shared_ptr<flight::Plan>& plan) {
                               const auto& states = plan->trajectory.states;
                               py::array_t<flight::FlightState> array(
                                   {static_cast<py::ssize_t>(states.size())}, states.data(),
                                   py::cast(plan));
                               array.attr("flags").attr("writeable") = false;
                               return array;
                             })
      .def("as_json", &output::plan_json)
      .def("write", &write_plan, py::arg("folder"), py::arg("overwrite") = false);
  module.def("plan", &make_plan);
  module.def(
      "read_plan",
      [](const std::string& folder) {
        const py::gil_scoped_release released;
        return std::make_shared<flight::Plan>(output::read_plan_bundle(folder));
      },
      py::arg("folder"));
  module.def("verify", &verify_plan, py::arg("map"), py::arg("folder"));
}

}  // namespace
}  // namespace hedgehop::python

PYBIND11_MODULE(_native, module) {
  hedgehop::python::add_errors(module);
  hedgehop::python::add_maps(module);
  hedgehop::python::add_plans(module);
  hedgehop::python::add_bus(module);
  module.attr("VERSION") = HEDGEHOP_VERSION;
}
