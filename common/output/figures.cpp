#include "output/figures.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdarg>
#include <cstdio>
#include <optional>
#include <system_error>
#include <utility>
#include <vector>

#include "base/angles.hpp"
#include "base/errors.hpp"
#include "base/files.hpp"
#include "output/gnuplot.hpp"
#include "output/map_images.hpp"
#include "output/plan_view.hpp"

namespace hedgehop::output {
namespace {

namespace fs = std::filesystem;

constexpr int kImageColumns = 900;
constexpr double kPdfPixelsPerInch = 96.0;
constexpr double kTitle_px = 74.0;       // title and subtitle
constexpr double kFooterLine_px = 17.0;  // one attribution
constexpr double kLeftAxis_px = 84.0;
constexpr double kGap_px = 42.0;
constexpr double kPanelTitle_px = 26.0;
constexpr double kBelowAxis_px = 52.0;
constexpr double kLegendLine_px = 19.0;
constexpr char kRouteColor[] = "#9be564";  // on maps, over a dark casing
constexpr char kTrackColor[] = "#5ac8ff";
constexpr char kRouteColorOnWhite[] = "#58a618";
constexpr char kTrackColorOnWhite[] = "#1583d0";
constexpr Color kNoFlyColor{0.84, 0.09, 0.12};
constexpr Color kAvoidColor{0.95, 0.55, 0.0};

const char* area_file(bool is_hard) { return is_hard ? "areas_no_fly" : "areas_avoid"; }

/// Rectangle of the canvas, from its lower left corner.
struct Box {
  double left_px = 0.0;
  double bottom_px = 0.0;
  double width_px = 0.0;
  double height_px = 0.0;
};

[[gnu::format(printf, 1, 2)]] std::string text_of(const char* format, ...) {
  std::array<char, 512> buffer{};
  va_list arguments;
  va_start(arguments, format);
  std::vsnprintf(buffer.data(), buffer.size(), format, arguments);
  va_end(arguments);
  return buffer.data();
}

/// What all figures of one plan share.
struct Scene {
  const flight::Plan* plan = nullptr;
  const map::Map* map = nullptr;
  const flight::RouteChoices* choices = nullptr;  // drawn in place of the plan's paths, if any
  MapWindow window;
  std::vector<double> distance_km;  // along the flown track, for each state
  PlanDemands demands;
  Headings headings;
  HeightRange range;
  double visibility_high = 1.0;  // upper end of the scale
  std::vector<LegendEntry> legend;
  double convergence_rad = 0.0;  // in the middle of the window
  double altitude_low_m = 0.0;   // axis of the profile
  double altitude_high_m = 0.0;
};

bool has_areas(const map::Map& map, bool is_hard) {
  return std::any_of(map.areas.begin(), map.areas.end(),
                     [&](const map::Area& area) { return area.is_hard == is_hard; });
}

Scene scene_of(const flight::Plan& plan, const map::Map& map,
               const flight::RouteChoices* choices = nullptr) {
  if (plan.trajectory.states.size() < 2 || plan.route_plan.route.waypoints.size() < 2) {
    throw DataError("figures: the plan has no path to draw", "plan again");
  }
  Scene scene;
  scene.plan = &plan;
  scene.map = &map;
  scene.choices = choices;
  std::vector<const std::vector<flight::Waypoint>*> routes;
  for (std::size_t i = 0; choices != nullptr && i < choices->routes.size(); ++i) {
    routes.push_back(&choices->routes[i].plan.route.waypoints);
  }
  scene.window = window_around({&plan}, map, routes);
  scene.range = surface_range(map, scene.window);
  scene.visibility_high = visibility_scale(map, scene.window);
  scene.headings = followed_headings(plan.trajectory);
  scene.legend = semantics_legend(map, scene.window);
  if (has_areas(map, true)) {
    scene.legend.push_back({kNoFlyColor, "no-fly area"});
  }
  if (has_areas(map, false)) {
    scene.legend.push_back({kAvoidColor, "area to avoid (dashed)"});
  }
  scene.demands = demands_of(plan.route_plan.config_text);
  const auto& states = plan.trajectory.states;
  scene.convergence_rad = states[states.size() / 2].convergence_rad;
  double along_m = 0.0;
  double low_m = std::numeric_limits<double>::infinity();
  double high_m = -low_m;
  for (std::size_t i = 0; i < states.size(); ++i) {
    if (i > 0) {
      const double dx_m = states[i].x_m - states[i - 1].x_m;
      const double dy_m = states[i].y_m - states[i - 1].y_m;
      along_m += std::sqrt(dx_m * dx_m + dy_m * dy_m);
    }
    scene.distance_km.push_back(along_m / 1000.0);
    low_m = std::fmin(low_m, std::fmin(states[i].terrain_m, states[i].altitude_m));
    high_m = std::fmax(high_m, states[i].altitude_m);
  }
  for (const flight::Waypoint& waypoint : plan.route_plan.route.waypoints) {
    high_m = std::fmax(high_m, waypoint.altitude_m);
  }
  scene.altitude_low_m = std::floor((low_m - 15.0) / 20.0) * 20.0;
  scene.altitude_high_m = std::ceil((high_m + 25.0) / 20.0) * 20.0;
  return scene;
}

// ---- data files

std::string paths_text(const std::vector<flight::Waypoint>& waypoints) {
  std::string text = "# x_km y_km altitude_m\n";
  for (const flight::Waypoint& waypoint : waypoints) {
    text += text_of("%.4f %.4f %.2f\n", waypoint.x_m / 1000.0, waypoint.y_m / 1000.0,
                    waypoint.altitude_m);
  }
  return text;
}

/// Places the route along the flown distance: each of its points where the flight passes nearest,
/// never backwards.
std::string planned_altitude_text(const Scene& scene) {
  const auto& states = scene.plan->trajectory.states;
  const flight::Route& route = scene.plan->route_plan.route;
  const auto& points = route.guide.size() >= 2 ? route.guide : route.waypoints;
  std::string text = "# distance_km altitude_m\n";
  std::size_t from = 0;
  double before_km = 0.0;
  double step_km = 0.0;
  for (std::size_t i = 0; i < points.size(); ++i) {
    if (i > 0) {
      const double dx_m = points[i].x_m - points[i - 1].x_m;
      const double dy_m = points[i].y_m - points[i - 1].y_m;
      step_km = std::sqrt(dx_m * dx_m + dy_m * dy_m) / 1000.0;
    }
    std::size_t nearest = from;
    double nearest_m2 = std::numeric_limits<double>::infinity();
    for (std::size_t j = from;
         j < states.size() && scene.distance_km[j] <= before_km + 3.0 * step_km + 0.3; ++j) {
      const double dx_m = states[j].x_m - points[i].x_m;
      const double dy_m = states[j].y_m - points[i].y_m;
      if (dx_m * dx_m + dy_m * dy_m < nearest_m2) {
        nearest_m2 = dx_m * dx_m + dy_m * dy_m;
        nearest = j;
      }
    }
    from = nearest;
    before_km = scene.distance_km[nearest];
    text += text_of("%.4f %.2f\n", before_km, points[i].altitude_m);
  }
  return text;
}

/// Every `stride`-th state and the last.
template <typename Visit>
void for_each_drawn_state(const Scene& scene, const Visit& visit) {
  const std::size_t count = scene.distance_km.size();
  const std::size_t stride = std::max<std::size_t>(1, count / 4000);
  for (std::size_t i = 0; i < count; i += stride) {
    visit(i);
  }
  if ((count - 1) % stride != 0) {
    visit(count - 1);
  }
}

std::string profile_text(const Scene& scene) {
  std::string text = "# distance_km x_km y_km terrain_m surface_m altitude_m height_m bank_deg\n";
  for_each_drawn_state(scene, [&](std::size_t i) {
    const flight::FlightState& s = scene.plan->trajectory.states[i];
    text += text_of("%.4f %.4f %.4f %.2f %.2f %.2f %.2f %.3f\n", scene.distance_km[i],
                    s.x_m / 1000.0, s.y_m / 1000.0, s.terrain_m, s.surface_m, s.altitude_m,
                    s.altitude_m - s.surface_m, degrees_from_radians(s.bank_rad));
  });
  return text;
}

std::string heading_text(const Scene& scene) {
  std::string text = "# distance_km heading_deg target_heading_deg, from true north, modulo 360\n";
  for_each_drawn_state(scene, [&](std::size_t i) {
    text += text_of("%.4f %.2f %.2f\n", scene.distance_km[i], scene.headings.flown_deg[i],
                    scene.headings.target_deg[i]);
  });
  return text;
}

/// Marks of the heading axis: compass points, whatever turn the axis is in.
std::string heading_tics(double low_deg, double high_deg) {
  static constexpr std::array<const char*, 8> kPoints = {"N", "NE", "E", "SE",
                                                         "S", "SW", "W", "NW"};
  const double range_deg = high_deg - low_deg;
  const int step = range_deg <= 200.0 ? 1 : range_deg <= 500.0 ? 2 : 4;
  std::string tics;
  for (long k = std::lround(std::ceil(low_deg / 45.0)); 45.0 * static_cast<double>(k) <= high_deg;
       ++k) {
    const long point = ((k % 8) + 8) % 8;
    if (point % step == 0) {
      tics += text_of("%s'%s %ld' %ld", tics.empty() ? "" : ", ",
                      kPoints[static_cast<std::size_t>(point)], point * 45, k * 45);
    }
  }
  return "(" + tics + ")";
}

std::string overhead_lines_text(const Scene& scene) {
  std::string text = "# x_km y_km of supports; a blank line between two lines\n";
  for (const map::OverheadLine& line : scene.map->overhead_lines) {
    for (const map::OverheadLine::Support& support : line.supports) {
      text += text_of("%.4f %.4f\n", support.point.x_m / 1000.0, support.point.y_m / 1000.0);
    }
    text += "\n";
  }
  return text;
}

std::string obstacles_text(const Scene& scene) {
  std::string text = "# x_km y_km radius_km of obstacles\n";
  for (const map::Obstacle& obstacle : scene.map->obstacles) {
    text += text_of("%.4f %.4f %.4f\n", obstacle.point.x_m / 1000.0, obstacle.point.y_m / 1000.0,
                    obstacle.radius_m / 1000.0);
  }
  return text;
}

std::string areas_text(const Scene& scene, bool is_hard) {
  std::string text = "# x_km y_km of corners; a blank line between two rings\n";
  const auto add = [&](const std::vector<geo::MapPoint>& ring) {
    for (const geo::MapPoint& corner : ring) {
      text += text_of("%.4f %.4f\n", corner.x_m / 1000.0, corner.y_m / 1000.0);
    }
    text += "\n";
  };
  for (const map::Area& area : scene.map->areas) {
    if (area.is_hard != is_hard) {
      continue;
    }
    for (const map::Area::Polygon& polygon : area.polygons) {
      add(polygon.outer);
      std::for_each(polygon.holes.begin(), polygon.holes.end(), add);
    }
  }
  return text;
}

/// A scale of 256 x 2 pixels, or 2 x 256 if it is upright; gnuplot draws no image that is one pixel
/// wide.
std::string bar_bytes(Color (*color)(double), bool is_upright) {
  const auto pixel = [&](int i) {
    const Color c = color(i / 255.0);
    std::string bytes;
    for (const double value : {c.red, c.green, c.blue}) {
      bytes += static_cast<char>(std::lround(255.0 * value));
    }
    return bytes;
  };
  std::string bytes;
  for (int i = 0; i < 512; ++i) {
    bytes += pixel(is_upright ? i / 2 : i % 256);
  }
  return bytes;
}

// ---- scripts

std::string duration_text(double duration_s) {
  if (!std::isfinite(duration_s) || std::fabs(duration_s) > 1e7) {
    return "unknown time";
  }
  const auto seconds = static_cast<long>(std::lround(duration_s));
  return text_of("%ld min %02ld s", seconds / 60, seconds % 60);
}

std::string metres_text(double value_m) {
  return std::isfinite(value_m) ? text_of("%.1f m", value_m) : "unknown";
}

std::string title_of(const Scene& scene) {
  if (scene.choices != nullptr) {
    return "Routes to choose from: " + std::to_string(scene.choices->routes.size());
  }
  const flight::Plan& plan = *scene.plan;
  const std::string verdict = plan.verdict.is_verified
                                  ? "verified"
                                  : text_of("NOT VERIFIED (%lld violations)",
                                            static_cast<long long>(plan.verdict.violation_count));
  return text_of("Contour flight: %.1f km in ", plan.measures.length_m / 1000.0) +
         duration_text(plan.measures.duration_s) + ", least clearance " +
         metres_text(plan.verdict.clearance_min_m) + ", " + verdict;
}

std::string subtitle_of(const Scene& scene) {
  const flight::Plan& plan = *scene.plan;
  if (scene.choices != nullptr) {
    return "plan " + plan.route_plan.request_id.hex().substr(0, 12) + ", map " +
           plan.route_plan.map.hash.hex().substr(0, 12) + ", seed " +
           std::to_string(plan.route_plan.request.seed);
  }
  std::string text = "mean height above the surface " + metres_text(plan.measures.mean_height_m);
  if (scene.demands.ceiling_height_m) {
    text += text_of(", %.1f %% of the length under %.0f m",
                    100.0 * plan.measures.share_under_ceiling, *scene.demands.ceiling_height_m);
  }
  return text + "   |   plan " + plan.route_plan.request_id.hex().substr(0, 12) + ", map " +
         plan.route_plan.map.hash.hex().substr(0, 12) + ", seed " +
         std::to_string(plan.route_plan.request.seed);
}

class Script {
 public:
  Script(const Scene& scene, double width_px, double height_px, const std::string& name)
      : scene_(scene), width_px_(width_px), height_px_(height_px) {
    add("# gnuplot -d -e \"kind='svg'\" " + name + ".gp draws " + name +
        ".svg.part; kind is png, svg or pdf\nif (!exists('kind')) kind = 'png'\n");
    const auto terminal = [&](const char* kind, const std::string& text) {
      add(std::string("if (kind eq '") + kind + "') { set terminal " + text +
          " noenhanced font 'DejaVu Sans,11' background '#ffffff' }\n");
    };
    terminal("png", text_of("pngcairo size %.0f,%.0f", width_px, height_px));
    terminal("svg", text_of("svg size %.0f,%.0f dynamic fontscale 1.2", width_px, height_px));
    terminal("pdf", text_of("pdfcairo size %.3fin,%.3fin", width_px / kPdfPixelsPerInch,
                            height_px / kPdfPixelsPerInch));
    add("set encoding utf8\nset output '" + name + ".'.kind.'.part'\n");
    add("set style line 1 lw 4.6 lc rgb '" + std::string(kRouteColor) + "'\n");
    add("set style line 2 lw 2.0 lc rgb '" + std::string(kTrackColor) + "'\n");
    add("set style line 3 lw 1.8 lc rgb '" + std::string(kRouteColorOnWhite) + "'\n");
    add("set style line 4 lw 2.0 lc rgb '" + std::string(kTrackColorOnWhite) + "'\n");
    add("set style textbox opaque noborder fillcolor rgb '#28ffffff' margins 0.5,0.5\n");
    add("set border lw 0.8 lc rgb '#404040'\nset tics textcolor rgb '#404040'\n");
    add("set multiplot\n");
    add_frame_texts();
  }

  static double footer_px(const Scene& scene) {
    return 14.0 +
           kFooterLine_px * static_cast<double>(scene.plan->route_plan.map.attributions.size());
  }

  void add(const std::string& text) { text_ += text; }

  [[nodiscard]] std::string finished() const { return text_ + "unset multiplot\nunset output\n"; }

  /// The next plot fills `box` between its axes.
  void place(const Box& box) {
    add(text_of("set lmargin at screen %.5f\nset rmargin at screen %.5f\n", box.left_px / width_px_,
                (box.left_px + box.width_px) / width_px_));
    add(text_of("set bmargin at screen %.5f\nset tmargin at screen %.5f\n",
                box.bottom_px / height_px_, (box.bottom_px + box.height_px) / height_px_));
  }

  void label(const std::string& text, double x_px, double y_px, const char* style) {
    add("set label " + gnuplot_quoted(text, 220) +
        text_of(" at screen %.5f, screen %.5f ", x_px / width_px_, y_px / height_px_) + style +
        "\n");
  }

  void clear_marks() { add("unset label\nunset arrow\nunset object\n"); }

 private:
  void add_frame_texts() {
    label(title_of(scene_), 24.0, height_px_ - 26.0,
          "left font 'DejaVu Sans:Bold,16' textcolor rgb '#202020'");
    label(subtitle_of(scene_), 24.0, height_px_ - 52.0,
          "left font 'DejaVu Sans,11' textcolor rgb '#505050'");
    const flight::MapIdentity& map = scene_.plan->route_plan.map;
    if (!map.label.empty()) {
      label(map.label, width_px_ - 24.0, height_px_ - 26.0,
            "right font 'DejaVu Sans:Bold,16' textcolor rgb '#c0392b'");
    }
    double y_px = footer_px(scene_) - 12.0;
    for (const std::string& line : map.attributions) {
      label(line, 24.0, y_px, "left font 'DejaVu Sans,9' textcolor rgb '#606060'");
      y_px -= kFooterLine_px;
    }
  }

  const Scene& scene_;
  double width_px_;
  double height_px_;
  std::string text_;
};

/// Corners of the window, as shares of its width and height, those far from both paths first.
std::array<std::pair<double, double>, 4> corners_far_from_paths(const Scene& scene) {
  std::array<std::pair<double, double>, 4> corners = {{{0, 0}, {1, 0}, {1, 1}, {0, 1}}};
  const MapWindow& w = scene.window;
  const auto distance2 = [&](const std::pair<double, double>& corner) {
    const double x_m = w.west_m + (0.1 + 0.8 * corner.first) * w.width_m();
    const double y_m = w.south_m + (0.08 + 0.84 * corner.second) * w.height_m();
    double nearest = std::numeric_limits<double>::infinity();
    const auto include = [&](double px_m, double py_m) {
      const double dx_m = px_m - x_m;
      const double dy_m = py_m - y_m;
      nearest = std::fmin(nearest, dx_m * dx_m + dy_m * dy_m);
    };
    for (const flight::FlightState& state : scene.plan->trajectory.states) {
      include(state.x_m, state.y_m);
    }
    for (const flight::Waypoint& waypoint : scene.plan->route_plan.route.waypoints) {
      include(waypoint.x_m, waypoint.y_m);
    }
    for (std::size_t i = 0; scene.choices != nullptr && i < scene.choices->routes.size(); ++i) {
      for (const flight::Waypoint& waypoint : scene.choices->routes[i].plan.route.waypoints) {
        include(waypoint.x_m, waypoint.y_m);
      }
    }
    return nearest;
  };
  std::stable_sort(corners.begin(), corners.end(),
                   [&](const auto& a, const auto& b) { return distance2(a) > distance2(b); });
  return corners;
}

void add_scale_bar(Script& script, const Scene& scene, const std::pair<double, double>& corner) {
  const double width_km = scene.window.width_m() / 1000.0;
  const double height_km = scene.window.height_m() / 1000.0;
  const double bar_km = round_number_below(0.25 * width_km);
  const double x_km =
      scene.window.west_m / 1000.0 + 0.045 * width_km + corner.first * (0.91 * width_km - bar_km);
  const double y_km = scene.window.south_m / 1000.0 + (0.05 + 0.86 * corner.second) * height_km;
  script.add(
      text_of("set object rectangle from %.4f,%.4f to %.4f,%.4f front fillcolor rgb "
              "'#30ffffff' fillstyle solid noborder\n",
              x_km - 0.02 * width_km, y_km - 0.025 * height_km, x_km + bar_km + 0.02 * width_km,
              y_km + 0.06 * height_km));
  script.add(text_of("set arrow from %.4f,%.4f to %.4f,%.4f nohead front lw 4 lc rgb '#202020'\n",
                     x_km, y_km, x_km + bar_km, y_km));
  script.add(text_of("set label '%g km' at %.4f,%.4f center front textcolor rgb '#202020'\n",
                     bar_km, x_km + 0.5 * bar_km, y_km + 0.03 * height_km));
}

void add_north_arrow(Script& script, const Scene& scene, const std::pair<double, double>& corner) {
  const double width_km = scene.window.width_m() / 1000.0;
  const double height_km = scene.window.height_m() / 1000.0;
  // True north lies at grid azimuth -convergence.
  const double convergence_rad = std::isfinite(scene.convergence_rad) ? scene.convergence_rad : 0.0;
  const double arrow_km = 0.08 * std::min(width_km, height_km);
  const double dx_km = -arrow_km * std::sin(convergence_rad);
  const double dy_km = arrow_km * std::cos(convergence_rad);
  const double centre_x_km =
      scene.window.west_m / 1000.0 + arrow_km + corner.first * (width_km - 2.0 * arrow_km);
  const double centre_y_km =
      scene.window.south_m / 1000.0 + arrow_km + corner.second * (height_km - 2.0 * arrow_km);
  script.add(
      text_of("set object circle at %.4f,%.4f size %.4f front fillcolor rgb '#30ffffff' "
              "fillstyle solid noborder\n",
              centre_x_km, centre_y_km, 0.8 * arrow_km));
  script.add(
      text_of("set arrow from %.4f,%.4f to %.4f,%.4f head filled size graph 0.018,18 front "
              "lw 2.5 lc rgb '#202020'\n",
              centre_x_km - 0.6 * dx_km, centre_y_km - 0.6 * dy_km, centre_x_km + 0.32 * dx_km,
              centre_y_km + 0.32 * dy_km));
  script.add(
      text_of("set label 'N' at %.4f,%.4f center front font 'DejaVu Sans:Bold,10' textcolor "
              "rgb '#202020'\n",
              centre_x_km + 0.52 * dx_km, centre_y_km + 0.52 * dy_km));
}

void add_map_marks(Script& script, const Scene& scene, bool with_arrow) {
  const auto& route = scene.plan->route_plan;
  for (const auto& [name, at] :
       {std::pair<const char*, const flight::Waypoint&>("start", route.start),
        {"goal", route.goal}}) {
    script.add(
        text_of("set label '%s' at %.4f,%.4f center offset 0,1.1 boxed front "
                "font 'DejaVu Sans:Bold,10' textcolor rgb '#202020'\n",
                name, at.x_m / 1000.0, at.y_m / 1000.0));
  }
  if (with_arrow) {
    const auto corners = corners_far_from_paths(scene);
    add_scale_bar(script, scene, corners[0]);
    add_north_arrow(script, scene, corners[1]);
  }
}

struct MapPanel {
  const char* title;
  const char* image;
};
constexpr std::array<MapPanel, 3> kMapPanels = {
    {{"Surface model", "surface.rgb"},
     {"Visibility: share of the surroundings that sees the place", "visibility.rgb"},
     {"Semantics", "semantics.rgb"}}};

void add_map_panel(Script& script, const Scene& scene, const MapPanel& panel, const Box& box,
                   bool with_x_axis, bool with_y_axis, bool with_arrow) {
  const MapWindow& w = scene.window;
  script.place(box);
  script.add(text_of("set xrange [%.5f:%.5f]\nset yrange [%.5f:%.5f]\n", w.west_m / 1000.0,
                     w.east_m / 1000.0, w.south_m / 1000.0, w.north_m / 1000.0));
  const double step_km = round_number_below(std::max(w.width_m(), w.height_m()) / 1000.0 / 3.5);
  script.add(
      text_of("set xtics %g out nomirror offset 0,0.3\nset ytics %g out nomirror offset 0.5,0\n",
              step_km, step_km));
  script.add(with_x_axis ? "set format x '%.6g'\nset xlabel 'grid east [km]' offset 0,0.7\n"
                         : "set format x ''\nunset xlabel\n");
  script.add(with_y_axis ? "set format y '%.6g'\nset ylabel 'grid north [km]' offset 0.6,0\n"
                         : "set format y ''\nunset ylabel\n");
  script.add("unset key\nunset grid\nset border 15\n");
  script.add("set title '" + std::string(panel.title) +
             "' offset 0,-0.6 font 'DejaVu Sans:Bold,11' textcolor rgb '#202020'\n");
  add_map_marks(script, scene, with_arrow);
  const int rows = static_cast<int>(std::lround(kImageColumns * w.height_m() / w.width_m()));
  const double dx_km = w.width_m() / 1000.0 / kImageColumns;
  const double dy_km = w.height_m() / 1000.0 / std::max(1, rows);
  script.add(
      text_of("plot '%s' binary array=(%d,%d) format='%%uchar' dx=%.9f dy=%.9f "
              "origin=(%.6f,%.6f) using 1:2:3 with rgbimage, \\\n",
              panel.image, kImageColumns, std::max(1, rows), dx_km, dy_km,
              w.west_m / 1000.0 + 0.5 * dx_km, w.south_m / 1000.0 + 0.5 * dy_km));
  if (!scene.map->overhead_lines.empty()) {
    script.add(
        "  'overhead_lines.dat' using 1:2 with lines lw 1.2 lc rgb '#5b2d91', \\\n"
        "  'overhead_lines.dat' using 1:2 with points pt 7 ps 0.25 lc rgb '#5b2d91', \\\n");
  }
  if (!scene.map->obstacles.empty()) {
    script.add(
        "  'obstacles.dat' using 1:2:3 with circles lw 1.2 lc rgb '#b5179e' fillstyle empty, \\\n"
        "  'obstacles.dat' using 1:2 with points pt 9 ps 0.8 lc rgb '#b5179e', \\\n");
  }
  for (const bool is_hard : {false, true}) {
    if (has_areas(*scene.map, is_hard)) {
      script.add(
          text_of("  '%s.dat' using 1:2 with lines lw 5 lc rgb '#ffffff', \\\n"
                  "  '%s.dat' using 1:2 with lines lw 2.4 dt %d lc rgb '%s', \\\n",
                  area_file(is_hard), area_file(is_hard), is_hard ? 1 : 2,
                  hex(is_hard ? kNoFlyColor : kAvoidColor).c_str()));
    }
  }
  if (scene.choices != nullptr) {
    // The plan's own last, so that it lies on top.
    for (std::size_t k = scene.choices->routes.size(); k-- > 0;) {
      script.add(
          text_of("  'choice_%zu.dat' using 1:2 with lines lw 5.4 lc rgb '#000000', \\\n"
                  "  'choice_%zu.dat' using 1:2 with lines lw 3.4 lc rgb '%s', \\\n",
                  k, k, choice_color(k).c_str()));
    }
    script.add(
        "  'ends.dat' using 1:2 with points pt 7 ps 1.9 lc rgb '#000000', \\\n"
        "  'ends.dat' using 1:2 with points pt 7 ps 1.3 lc rgb '#ffffff'\n");
    script.clear_marks();
    return;
  }
  script.add(
      "  'route.dat' using 1:2 with lines lw 6.6 lc rgb '#000000', \\\n"
      "  'route.dat' using 1:2 with lines ls 1, \\\n"
      "  'route.dat' using 1:2 with points pt 7 ps 0.75 lc rgb '#9be564', \\\n"
      "  'profile.dat' using 2:3 with lines lw 3.4 lc rgb '#000000', \\\n"
      "  'profile.dat' using 2:3 with lines ls 2, \\\n"
      "  'ends.dat' using 1:2 with points pt 7 ps 1.9 lc rgb '#000000', \\\n"
      "  'ends.dat' using 1:2 with points pt 7 ps 1.3 lc rgb '#ffffff'\n");
  script.clear_marks();
}

void add_bar(Script& script, const Box& box, const char* file, double low, double high,
             const char* label, bool is_upright) {
  script.place(box);
  const double length = std::max(high - low, 1e-3);
  const double step = round_number_below(length / 3.0);
  script.add("unset title\nunset xlabel\nunset ylabel\nset border 15\n");
  const std::string plot = text_of("plot '%s' binary array=(%s) format='%%uchar' ", file,
                                   is_upright ? "2,256" : "256,2");
  const std::string range = text_of("[%.4f:%.4f]", low, low + length);
  if (is_upright) {
    script.add("unset xtics\nset format y '%g'\nset xrange [0:1]\nset yrange " + range + "\n");
    script.add(text_of("unset ytics\nset y2tics %g out nomirror offset -0.5,0\nset y2range %s\n",
                       step, range.c_str()));
    script.add("set title '" + std::string(label) +
               "' offset 0,-0.5 font 'DejaVu Sans,10' textcolor rgb '#404040'\n");
    script.add(plot + text_of("dx=0.5 dy=%.9f origin=(0.25,%.6f) using 1:2:3 with rgbimage\n",
                              length / 256.0, low + length / 512.0));
    script.add("unset y2tics\nunset title\nset xtics\nset ytics\n");
  } else {
    script.add("unset ytics\nset format x '%g'\nset yrange [0:1]\nset xrange " + range + "\n");
    script.add(text_of("set xtics %g out nomirror offset 0,0.4\n", step));
    script.add("set xlabel '" + std::string(label) +
               "' offset 0,0.9 font 'DejaVu Sans,10' textcolor rgb '#404040'\n");
    script.add(plot + text_of("dx=%.9f dy=0.5 origin=(%.6f,0.25) using 1:2:3 with rgbimage\n",
                              length / 256.0, low + length / 512.0));
    script.add("unset xlabel\nset ytics\n");
  }
}

/// Colours of the classes, in columns from the upper left corner of `box`, then the two paths.
void add_legend(Script& script, const Scene& scene, const Box& box, int columns) {
  script.place(box);
  script.add(text_of("set xrange [0:%.1f]\nset yrange [0:%.1f]\n", box.width_px, box.height_px));
  script.add("unset tics\nset border 0\nunset title\nunset xlabel\nunset ylabel\n");
  const int entries = static_cast<int>(scene.legend.size());
  const int lines = std::max(1, (entries + columns - 1) / columns);
  for (int i = 0; i < entries; ++i) {
    const LegendEntry& entry = scene.legend[static_cast<std::size_t>(i)];
    const double x_px = (i / lines) * box.width_px / columns;
    const double y_px = box.height_px - (i % lines + 0.5) * kLegendLine_px;
    script.add(
        text_of("set object rectangle from %.1f,%.1f to %.1f,%.1f fillcolor rgb '%s' "
                "fillstyle solid border lc rgb '#808080'\n",
                x_px, y_px - 6.0, x_px + 18.0, y_px + 6.0, hex(entry.color).c_str()));
    script.add("set label '" + entry.text +
               text_of("' at %.1f,%.1f left font 'DejaVu Sans,10' textcolor rgb '#404040'\n",
                       x_px + 25.0, y_px));
  }
  script.add("plot NaN notitle\n");
  script.clear_marks();
  script.add("set tics\nset border 15\n");
}

/// The two paths by name, at the right end of the line of the subtitle.
void add_path_legend(Script& script, double width_px, double height_px) {
  const double y_px = height_px - 52.0;
  double x_px = width_px - 24.0;
  for (const auto& [name, color, length_px] :
       {std::tuple("flown trajectory", kTrackColor, 130.0),
        std::tuple("planned route, waypoints", kRouteColor, 205.0)}) {
    script.label(name, x_px, y_px, "right font 'DejaVu Sans,11' textcolor rgb '#404040'");
    x_px -= length_px;
    for (const auto& [lw, c] : {std::pair(6.5, "#000000"), std::pair(3.5, color)}) {
      script.add(
          text_of("set arrow from screen %.5f, screen %.5f to screen %.5f, screen %.5f nohead "
                  "lw %.1f lc rgb '%s'\n",
                  (x_px - 40.0) / width_px, y_px / height_px, (x_px - 6.0) / width_px,
                  y_px / height_px, lw, c));
    }
    x_px -= 62.0;
  }
}

/// The routes to choose from, each on a line below the title.
void add_choice_legend(Script& script, const Scene& scene, double width_px, double height_px) {
  const auto& routes = scene.choices->routes;
  for (std::size_t i = 0; i < routes.size(); ++i) {
    const double y_px = height_px - kTitle_px - kLegendLine_px * (static_cast<double>(i) + 0.5);
    for (const auto& [lw, color] :
         {std::pair(6.5, std::string("#000000")), std::pair(3.5, choice_color(i))}) {
      script.add(text_of(
          "set arrow from screen %.5f, screen %.5f to screen %.5f, screen %.5f nohead "
          "lw %.1f lc rgb '%s'\n",
          24.0 / width_px, y_px / height_px, 58.0 / width_px, y_px / height_px, lw, color.c_str()));
    }
    const flight::RouteMeasures& m = routes[i].measures;
    script.label(routes[i].name, 70.0, y_px,
                 "left font 'DejaVu Sans:Bold,11' textcolor rgb '#202020'");
    script.label(text_of("%.2f km, seen %.0f m, land use %.0f m", m.length_m / 1000.0,
                         m.visibility_m, m.semantics_m),
                 230.0, y_px, "left font 'DejaVu Sans,11' textcolor rgb '#404040'");
  }
}

double legend_lines(const Scene& scene, int columns) {
  const int entries = static_cast<int>(scene.legend.size());
  return std::max(1, (entries + columns - 1) / columns);
}

double side_by_side_height_px(const Scene& scene, double width_px) {
  const double panel_px = (width_px - kLeftAxis_px - 2.0 * kGap_px - 24.0) / 3.0;
  return kPanelTitle_px + panel_px * scene.window.height_m() / scene.window.width_m() +
         kBelowAxis_px + std::max(46.0, legend_lines(scene, 2) * kLegendLine_px) + 8.0;
}

/// Three maps in a row; `area` must have the height above.
void add_maps_side_by_side(Script& script, const Scene& scene, const Box& area) {
  const double panel_px = (area.width_px - kLeftAxis_px - 2.0 * kGap_px - 24.0) / 3.0;
  const double height_px = panel_px * scene.window.height_m() / scene.window.width_m();
  const double bottom_px = area.bottom_px + area.height_px - kPanelTitle_px - height_px;
  std::array<Box, 3> boxes;
  for (std::size_t i = 0; i < 3; ++i) {
    boxes[i] = {area.left_px + kLeftAxis_px + static_cast<double>(i) * (panel_px + kGap_px),
                bottom_px, panel_px, height_px};
    add_map_panel(script, scene, kMapPanels[i], boxes[i], true, i == 0, i == 0);
  }
  const double below_px = bottom_px - kBelowAxis_px;
  const auto bar_below = [&](const Box& box) {
    return Box{box.left_px + 0.1 * panel_px, below_px - 14.0, 0.8 * panel_px, 13.0};
  };
  if (std::isfinite(scene.range.low_m)) {
    add_bar(script, bar_below(boxes[0]), "surface_bar_across.rgb", scene.range.low_m,
            scene.range.high_m, "surface altitude [m AMSL]", false);
  }
  add_bar(script, bar_below(boxes[1]), "visibility_bar_across.rgb", 0.0,
          100.0 * scene.visibility_high, "seen from [%] of the surroundings", false);
  const double legend_px = legend_lines(scene, 2) * kLegendLine_px;
  add_legend(script, scene, {boxes[2].left_px, below_px - legend_px, panel_px, legend_px}, 2);
}

constexpr double kSideStrip_px = 300.0;

double stacked_height_px(const Scene& scene, double width_px) {
  const double panel_px = width_px - kLeftAxis_px - kSideStrip_px;
  return 3.0 *
             (kPanelTitle_px + panel_px * scene.window.height_m() / scene.window.width_m() + 12.0) +
         kBelowAxis_px;
}

/// Three maps above each other, scales and legend on their right.
void add_maps_stacked(Script& script, const Scene& scene, const Box& area) {
  const double panel_px = area.width_px - kLeftAxis_px - kSideStrip_px;
  const double height_px = panel_px * scene.window.height_m() / scene.window.width_m();
  double top_px = area.bottom_px + area.height_px;
  const double strip_px = area.left_px + kLeftAxis_px + panel_px + 26.0;
  for (std::size_t i = 0; i < 3; ++i) {
    const Box box{area.left_px + kLeftAxis_px, top_px - kPanelTitle_px - height_px, panel_px,
                  height_px};
    add_map_panel(script, scene, kMapPanels[i], box, i == 2, true, i == 0);
    const Box bar{strip_px + 40.0, box.bottom_px + 0.08 * height_px, 16.0, 0.8 * height_px};
    if (i == 0 && std::isfinite(scene.range.low_m)) {
      add_bar(script, bar, "surface_bar_up.rgb", scene.range.low_m, scene.range.high_m,
              "altitude [m]", true);
    } else if (i == 1) {
      add_bar(script, bar, "visibility_bar_up.rgb", 0.0, 100.0 * scene.visibility_high, "seen [%]",
              true);
    } else if (i == 2) {
      const double legend_px = legend_lines(scene, 1) * kLegendLine_px;
      add_legend(script, scene,
                 {strip_px, box.bottom_px + height_px - legend_px, kSideStrip_px - 30.0, legend_px},
                 1);
    }
    top_px -= kPanelTitle_px + height_px + 12.0;
  }
}

void add_profiles(Script& script, const Scene& scene, const Box& area) {
  const double left_px = area.left_px + kLeftAxis_px;
  const double width_px = area.width_px - kLeftAxis_px - 32.0;
  const double gap_px = 34.0;
  const double usable_px = area.height_px - kBelowAxis_px - 4.0 * gap_px;
  double top_px = area.bottom_px + area.height_px - gap_px;
  const auto next_box = [&](double share) {
    const double height_px = share * usable_px;
    const Box box{left_px, top_px - height_px, width_px, height_px};
    top_px -= height_px + gap_px;
    return box;
  };
  script.add(text_of("set xrange [0:%.4f]\nset xtics auto out nomirror offset 0,0.3\n",
                     std::max(scene.distance_km.back(), 0.01)));
  script.add("unset title\nunset xlabel\nset format x ''\nset format y '%g'\nset border 3\n");
  script.add("set ytics auto out nomirror offset 0.5,0\n");
  script.add("set grid xtics ytics lt 1 lw 0.6 lc rgb '#e4e4e4'\nset grid front\nunset grid\n");
  script.add("set grid xtics ytics back lt 1 lw 0.6 lc rgb '#e4e4e4'\n");
  script.add(
      "set key at graph 0, graph 1.0 left bottom horizontal Left reverse width 1 height 0.2 "
      "samplen "
      "2.2 maxrows 1 font 'DejaVu Sans,10' noautotitle\n");

  const PlanDemands& demands = scene.demands;
  // Altitude.
  script.place(next_box(0.42));
  script.add(text_of("set yrange [%.1f:%.1f]\n", scene.altitude_low_m, scene.altitude_high_m));
  script.add("set ylabel 'altitude [m AMSL]' offset 0.6,0\n");
  script.add(
      "plot 'profile.dat' using 1:4:5 with filledcurves lc rgb '#a9cba1' title 'trees and "
      "buildings', \\\n");
  script.add(
      text_of("  'profile.dat' using 1:4 with filledcurves y1=%.1f lc rgb '#c9b79c' title "
              "'terrain', \\\n",
              scene.altitude_low_m));
  script.add("  'profile.dat' using 1:5 with lines lw 0.8 lc rgb '#5d7a55', \\\n");
  if (demands.reference_height_m) {
    script.add(
        text_of("  'profile.dat' using 1:($5+%.3f) with lines lw 1 dt 2 lc rgb '#808080' title "
                "'surface + %.4g m, reference height', \\\n",
                *demands.reference_height_m, *demands.reference_height_m));
  }
  if (demands.ceiling_height_m) {
    script.add(
        text_of("  'profile.dat' using 1:($5+%.3f) with lines lw 1 dt 3 lc rgb '#b03030' title "
                "'surface + %.4g m, ceiling', \\\n",
                *demands.ceiling_height_m, *demands.ceiling_height_m));
  }
  script.add(
      "  'planned.dat' using 1:2 with lines ls 3 title 'planned route', \\\n"
      "  'profile.dat' using 1:6 with lines ls 4 title 'flown trajectory'\n");

  // Height above the surface.
  script.place(next_box(0.2));
  script.add("set yrange [0:*]\nset ylabel 'height [m]' offset 0.6,0\n");
  script.add("plot ");
  if (demands.ceiling_height_m) {
    script.add(text_of("%.3f with lines lw 1 dt 3 lc rgb '#b03030' title 'ceiling', ",
                       *demands.ceiling_height_m));
  }
  if (demands.reference_height_m) {
    script.add(text_of("%.3f with lines lw 1 dt 2 lc rgb '#808080' title 'reference height', ",
                       *demands.reference_height_m));
  }
  if (demands.required_clearance_m) {
    script.add(text_of("%.3f with lines lw 1.2 lc rgb '#d62728' title 'required clearance', ",
                       *demands.required_clearance_m));
  }
  script.add("\\\n  'profile.dat' using 1:7 with lines ls 4 title 'flown, above the surface'\n");

  // Bank.
  script.place(next_box(0.17));
  double bank_deg = 10.0;
  for (const flight::FlightState& state : scene.plan->trajectory.states) {
    bank_deg = std::fmax(bank_deg, std::fabs(degrees_from_radians(state.bank_rad)));
  }
  if (demands.bank_max_rad) {
    bank_deg = std::max(bank_deg, degrees_from_radians(*demands.bank_max_rad));
  }
  script.add(text_of("set yrange [%.1f:%.1f]\nset ytics %g\n", -1.15 * bank_deg, 1.15 * bank_deg,
                     round_number_below(bank_deg)));
  script.add("set ylabel 'bank [°]' offset 0.6,0\nplot 0 with lines lw 0.8 lc rgb '#b0b0b0', ");
  if (demands.bank_max_rad) {
    const double limit_deg = degrees_from_radians(*demands.bank_max_rad);
    script.add(
        text_of("%.3f with lines lw 1 dt 3 lc rgb '#b03030' title 'limit', %.3f with lines lw 1 "
                "dt 3 lc rgb '#b03030', ",
                limit_deg, -limit_deg));
  }
  script.add("\\\n  'profile.dat' using 1:8 with lines ls 4 title 'bank, right positive'\n");

  // Heading.
  script.place(next_box(0.21));
  script.add("set format x '%g'\nset xlabel 'distance flown [km]' offset 0,0.7\n");
  const double low_deg = scene.headings.low_deg - 8.0;
  const double high_deg = std::max(scene.headings.high_deg + 8.0, low_deg + 60.0);
  script.add(text_of("set yrange [%.2f:%.2f]\nset ytics ", low_deg, high_deg) +
             heading_tics(low_deg, high_deg) + "\nunset ylabel\n");  // the marks need its room
  script.add(
      "plot 'heading.dat' using 1:3 with lines lw 1.1 lc rgb '#e08e36' title 'target heading [°]', "
      "\\\n  'heading.dat' using 1:2 with lines ls 4 title 'heading [°], from true north'\n");
  script.add("unset grid\nset ytics auto\n");
}

/// Folder, pictures of the layers, and the data that all maps of a figure show.
void write_layers(const Scene& scene, const fs::path& folder) {
  const map::Map& map = *scene.map;
  std::error_code error;
  fs::create_directories(folder, error);
  if (error) {
    throw SystemFailure("figures: " + folder.string() + ": " + error.message(),
                        "give a folder that can be written");
  }
  write_file_atomically(folder / "surface.rgb",
                        surface_image(map, scene.window, kImageColumns).bytes);
  write_file_atomically(
      folder / "visibility.rgb",
      visibility_image(map, scene.window, kImageColumns, scene.visibility_high).bytes);
  write_file_atomically(folder / "semantics.rgb",
                        semantics_image(map, scene.window, kImageColumns).bytes);
  for (const bool is_upright : {false, true}) {
    const std::string suffix = is_upright ? "_up.rgb" : "_across.rgb";
    write_file_atomically(folder / ("surface_bar" + suffix), bar_bytes(surface_tint, is_upright));
    write_file_atomically(folder / ("visibility_bar" + suffix),
                          bar_bytes(visibility_color, is_upright));
  }
  write_file_atomically(folder / "ends.dat",
                        paths_text({scene.plan->route_plan.start, scene.plan->route_plan.goal}));
  write_file_atomically(folder / "overhead_lines.dat", overhead_lines_text(scene));
  write_file_atomically(folder / "obstacles.dat", obstacles_text(scene));
  for (const bool is_hard : {false, true}) {
    write_file_atomically(folder / (std::string(area_file(is_hard)) + ".dat"),
                          areas_text(scene, is_hard));
  }
}

/// Draws one figure in every format, each of which appears under its name only when it is complete.
void draw(const fs::path& folder, const std::string& name, const Script& script) {
  write_file_atomically(folder / (name + ".gp"), script.finished());
  for (const char* kind : {"png", "svg", "pdf"}) {
    const fs::path finished = folder / (name + "." + kind);
    const fs::path unfinished = finished.string() + ".part";
    std::error_code error;
    fs::remove(unfinished, error);
    try {
      run_gnuplot(folder, name + ".gp", std::string("kind='") + kind + "'");
      if (!fs::is_regular_file(unfinished, error) || fs::file_size(unfinished, error) == 0) {
        throw SystemFailure("figures: gnuplot left no picture in " + folder.string(),
                            "is the disk full?");
      }
      fs::rename(unfinished, finished, error);
      if (error) {
        throw SystemFailure("figures: " + finished.string() + ": " + error.message());
      }
    } catch (...) {
      fs::remove(unfinished, error);
      throw;
    }
  }
}

}  // namespace

void write_figures(const flight::Plan& plan, const map::Map& map, const fs::path& folder) {
  const Scene scene = scene_of(plan, map);
  write_layers(scene, folder);
  write_file_atomically(folder / "route.dat", paths_text(plan.route_plan.route.waypoints));
  write_file_atomically(folder / "planned.dat", planned_altitude_text(scene));
  write_file_atomically(folder / "profile.dat", profile_text(scene));
  write_file_atomically(folder / "heading.dat", heading_text(scene));

  const double footer_px = Script::footer_px(scene);
  const bool is_wide = scene.window.width_m() > 1.6 * scene.window.height_m();
  {
    const double width_px = is_wide ? 1500.0 : 2100.0;
    const double area_px =
        is_wide ? stacked_height_px(scene, width_px) : side_by_side_height_px(scene, width_px);
    const double height_px = std::ceil(kTitle_px + area_px + footer_px);
    Script script(scene, width_px, height_px, "map");
    add_path_legend(script, width_px, height_px);
    const Box area{0.0, footer_px, width_px, area_px};
    if (is_wide) {
      add_maps_stacked(script, scene, area);
    } else {
      add_maps_side_by_side(script, scene, area);
    }
    draw(folder, "map", script);
  }
  {
    const double width_px = 1500.0;
    const double area_px = 900.0;
    Script script(scene, width_px, std::ceil(kTitle_px + area_px + footer_px), "profile");
    add_profiles(script, scene, {0.0, footer_px, width_px, area_px});
    draw(folder, "profile", script);
  }
  {
    const double width_px = 1900.0;
    const double maps_px = side_by_side_height_px(scene, width_px);
    const double profiles_px = 760.0;
    const double height_px = std::ceil(kTitle_px + maps_px + 20.0 + profiles_px + footer_px);
    Script script(scene, width_px, height_px, "plan");
    add_path_legend(script, width_px, height_px);
    add_maps_side_by_side(script, scene, {0.0, footer_px + profiles_px + 20.0, width_px, maps_px});
    add_profiles(script, scene, {0.0, footer_px, width_px, profiles_px});
    draw(folder, "plan", script);
  }
}

void write_choice_figure(const flight::Plan& plan, const map::Map& map,
                         const flight::RouteChoices& choices, const fs::path& folder) {
  const Scene scene = scene_of(plan, map, &choices);
  // The window is another one than that of the plan alone.
  const fs::path inside = folder / "alternatives";
  write_layers(scene, inside);
  for (std::size_t i = 0; i < choices.routes.size(); ++i) {
    write_file_atomically(inside / text_of("choice_%zu.dat", i),
                          paths_text(choices.routes[i].plan.route.waypoints));
  }
  const double legend_px = kLegendLine_px * static_cast<double>(choices.routes.size()) + 8.0;
  const double footer_px = Script::footer_px(scene);
  const bool is_wide = scene.window.width_m() > 1.6 * scene.window.height_m();
  const double width_px = is_wide ? 1500.0 : 2100.0;
  const double area_px =
      is_wide ? stacked_height_px(scene, width_px) : side_by_side_height_px(scene, width_px);
  const double height_px = std::ceil(kTitle_px + legend_px + area_px + footer_px);
  Script script(scene, width_px, height_px, "alternatives");
  add_choice_legend(script, scene, width_px, height_px);
  const Box area{0.0, footer_px, width_px, area_px};
  if (is_wide) {
    add_maps_stacked(script, scene, area);
  } else {
    add_maps_side_by_side(script, scene, area);
  }
  draw(inside, "alternatives", script);
}

}  // namespace hedgehop::output
