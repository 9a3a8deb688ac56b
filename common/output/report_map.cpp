#include "output/report_map.hpp"

#include <algorithm>
#include <cmath>

#include "output/png_image.hpp"
#include "output/report_text.hpp"

namespace hedgehop::output {
namespace {

constexpr int kColumns = 760;

/// A layer that can be switched on and off.
struct Layer {
  std::string id;    // of its check box
  std::string name;  // escaped
  std::string drawing;
  bool is_on = true;
};

std::string image_of(const Image& image, const DrawingFrame& frame, const char* classes) {
  return std::string("<image class=\"") + classes + "\" x=\"0\" y=\"0\" width=\"1000\" height=\"" +
         fixed_text(frame.height(), 3) + "\" preserveAspectRatio=\"none\" href=\"" +
         png_data_url(image) + "\"/>";
}

template <typename Points>
std::string path_of(const Points& points, const DrawingFrame& frame, std::size_t stride = 1) {
  std::string path;
  const auto add = [&](std::size_t i) {
    path += (path.empty() ? "M" : "L") + fixed_text(frame.x(points[i].x_m), 2) + " " +
            fixed_text(frame.y(points[i].y_m), 2);
  };
  for (std::size_t i = 0; i < points.size(); i += stride) {
    add(i);
  }
  if (!points.empty() && (points.size() - 1) % stride != 0) {
    add(points.size() - 1);
  }
  return path;
}

std::string stroked(const std::string& path, const char* classes) {
  return path.empty() ? "" : std::string("<path class=\"") + classes + "\" d=\"" + path + "\"/>";
}

std::string track_path(const flight::Plan& plan, const DrawingFrame& frame) {
  const auto& states = plan.trajectory.states;
  return path_of(states, frame, std::max<std::size_t>(1, states.size() / 2000));
}

/// A dot that keeps its size however the drawing is scaled.
std::string dot(double x, double y, const char* color, double size_px) {
  return "<path class=\"dot\" stroke=\"" + std::string(color) + "\" stroke-width=\"" +
         fixed_text(size_px, 1) + "\" d=\"M" + fixed_text(x, 2) + " " + fixed_text(y, 2) +
         "h.01\"/>";
}

std::string end_mark(const flight::Waypoint& place, const std::string& name,
                     const DrawingFrame& frame) {
  const double x = frame.x(place.x_m);
  const double y = frame.y(place.y_m);
  const bool is_right = x > 850.0;
  return dot(x, y, "#000", 15.0) + dot(x, y, "#fff", 10.0) + "<text x=\"" +
         fixed_text(x + (is_right ? -12.0 : 12.0), 2) + "\" y=\"" +
         fixed_text(y < 45.0 ? y + 34.0 : y - 14.0, 2) + "\"" +
         (is_right ? " text-anchor=\"end\"" : "") + ">" + name + "</text>";
}

std::string things_of(const ReportContent& content, const DrawingFrame& frame) {
  const map::Map& map = *content.map;
  const MapWindow& w = frame.window;
  std::string drawing;
  const auto is_near = [&](const geo::MapPoint& p) {
    return p.x_m >= w.west_m && p.x_m <= w.east_m && p.y_m >= w.south_m && p.y_m <= w.north_m;
  };
  std::string wires;
  for (const map::OverheadLine& line : map.overhead_lines) {
    std::vector<geo::MapPoint> points;
    for (const auto& support : line.supports) {
      points.push_back(support.point);
    }
    // A span may pass through although none of its ends lies inside.
    double west_m = points.front().x_m, east_m = west_m;
    double south_m = points.front().y_m, north_m = south_m;
    for (const geo::MapPoint& p : points) {
      west_m = std::min(west_m, p.x_m);
      east_m = std::max(east_m, p.x_m);
      south_m = std::min(south_m, p.y_m);
      north_m = std::max(north_m, p.y_m);
    }
    if (west_m <= w.east_m && east_m >= w.west_m && south_m <= w.north_m && north_m >= w.south_m) {
      wires += path_of(points, frame);
    }
  }
  drawing += stroked(wires, "wires");
  for (const map::Obstacle& obstacle : map.obstacles) {
    if (is_near(obstacle.point)) {
      const double x = frame.x(obstacle.point.x_m);
      const double y = frame.y(obstacle.point.y_m);
      drawing += "<circle class=\"obstacle\" cx=\"" + fixed_text(x, 2) + "\" cy=\"" +
                 fixed_text(y, 2) + "\" r=\"" +
                 fixed_text(1000.0 * obstacle.radius_m / w.width_m(), 2) + "\"/>" +
                 dot(x, y, "#b5179e", 6.0);
    }
  }
  for (const map::Area& area : map.areas) {
    std::string rings;
    for (const map::Area::Polygon& polygon : area.polygons) {
      rings += path_of(polygon.outer, frame);
      for (const auto& hole : polygon.holes) {
        rings += path_of(hole, frame);
      }
    }
    if (!rings.empty()) {
      drawing += "<path class=\"" + std::string(area.is_hard ? "no-fly" : "avoid") + "\" d=\"" +
                 rings + "\"><title>" + html_escaped(area.name) + "</title></path>";
    }
  }
  return drawing;
}

/// In the lower left corner, or the right one if the flight is there.
std::string scale_bar(const ReportContent& content, const DrawingFrame& frame) {
  const double bar_m = round_number_below(0.25 * frame.window.width_m());
  const double length = 1000.0 * bar_m / frame.window.width_m();
  const double y = frame.height() - 25.0;
  const auto& states = content.plan->trajectory.states;
  const bool is_left_taken =
      std::any_of(states.begin(), states.end(), [&](const flight::FlightState& state) {
        return frame.x(state.x_m) < length + 60.0 && frame.y(state.y_m) > frame.height() - 130.0;
      });
  const double left = is_left_taken ? 975.0 - length : 25.0;
  const std::string text =
      bar_m >= 1000.0 ? fixed_text(bar_m / 1000.0, 0) + " km" : fixed_text(bar_m, 0) + " m";
  return "<line class=\"scale\" x1=\"" + fixed_text(left, 1) + "\" x2=\"" +
         fixed_text(left + length, 1) + "\" y1=\"" + fixed_text(y, 1) + "\" y2=\"" +
         fixed_text(y, 1) + "\"/><text x=\"" + fixed_text(left + 0.5 * length, 1) + "\" y=\"" +
         fixed_text(y - 12.0, 1) + "\" text-anchor=\"middle\">" + text + "</text>";
}

std::string legends(const ReportContent& content, const DrawingFrame& frame) {
  const map::Map& map = *content.map;
  std::string keys = "<ul class=\"keys\"><li>" + key_line("#1583d0", "flown trajectory") +
                     "</li><li>" + key_line("#58a618", "planned route") + "</li>";
  for (std::size_t i = 1; i < content.choices.size(); ++i) {
    keys += "<li>" + key_line(choice_color(i), "route '" + content.choices[i].route.name + "'") +
            "</li>";
  }
  if (!content.alternatives.empty()) {
    keys += "<li>" + key_line("#ffd23f", "alternatives", true) + "</li>";
  }
  if (!map.overhead_lines.empty()) {
    keys += "<li>" + key_line("#5b2d91", "overhead lines") + "</li>";
  }
  if (!map.obstacles.empty()) {
    keys += "<li>" + key_box("#b5179e", "obstacles with their radius") + "</li>";
  }
  if (!map.areas.empty()) {
    keys += "<li>" + key_line("#d6171f", "no-fly area") + "</li><li>" +
            key_line("#f28c00", "area to avoid", true) + "</li>";
  }
  keys += "</ul><ul class=\"keys\">";
  const HeightRange range = surface_range(map, frame.window);
  if (std::isfinite(range.low_m)) {
    for (const double share : {0.0, 0.5, 1.0}) {
      keys +=
          "<li>" +
          key_box(hex(surface_tint(share)),
                  "surface " + fixed_text(range.low_m + share * (range.high_m - range.low_m), 0) +
                      " m") +
          "</li>";
    }
  }
  const double high = visibility_scale(map, frame.window);
  for (const double share : {0.0, 0.5, 1.0}) {
    keys += "<li>" +
            key_box(hex(visibility_color(share)),
                    "seen from " + fixed_text(100.0 * share * high, 0) + " %") +
            "</li>";
  }
  if (!content.threats.empty()) {
    keys += "<li>" + key_box("#ff8c80", "seen by the observer at reference height") + "</li>";
  }
  keys += "</ul><ul class=\"keys\">";
  for (const LegendEntry& entry : semantics_legend(map, frame.window)) {
    keys += "<li>" + key_box(hex(entry.color), entry.text) + "</li>";
  }
  return keys + "</ul>\n";
}

}  // namespace

DrawingFrame drawing_frame(const ReportContent& content) {
  std::vector<const flight::Plan*> plans = {content.plan};
  for (const ReportAlternative& alternative : content.alternatives) {
    plans.push_back(alternative.plan);
  }
  std::vector<const std::vector<flight::Waypoint>*> routes;
  for (const ReportChoice& choice : content.choices) {
    routes.push_back(&choice.route.waypoints);
  }
  return {window_around(plans, *content.map, routes)};
}

std::string report_map(const ReportContent& content, const DrawingFrame& frame) {
  const map::Map& map = *content.map;
  const MapWindow& window = frame.window;
  std::vector<Layer> layers;
  layers.push_back({"layer-surface", "surface",
                    image_of(surface_tint_image(map, window, kColumns), frame, "layer"), true});
  layers.push_back({"layer-visibility", "visibility",
                    image_of(visibility_image(map, window, kColumns, visibility_scale(map, window)),
                             frame, "layer"),
                    false});
  layers.push_back({"layer-land-use", "land use",
                    image_of(semantics_tint_image(map, window, kColumns), frame, "layer"), false});
  for (std::size_t i = 0; i < content.threats.size(); ++i) {
    layers.push_back(
        {"layer-observer-" + std::to_string(i + 1),
         "seen by " + html_escaped(content.threats[i].name),
         image_of(seen_image(content.threats[i].height_m, window, kColumns, map.reference_height_m),
                  frame, "layer"),
         false});
  }
  layers.push_back({"layer-things", "wires, obstacles, areas", things_of(content, frame), true});
  if (!content.alternatives.empty()) {
    std::string others;
    for (const ReportAlternative& alternative : content.alternatives) {
      others += "<path class=\"other\" d=\"" + track_path(*alternative.plan, frame) + "\"><title>" +
                html_escaped(alternative.name) + "</title></path>";
    }
    layers.push_back({"layer-alternatives", "alternatives", others, true});
  }
  if (content.choices.size() > 1) {
    std::string routes;
    for (std::size_t i = 1; i < content.choices.size(); ++i) {
      const ListedRoute& choice = content.choices[i].route;
      const std::string path = path_of(choice.waypoints, frame);
      routes += stroked(path, "track-casing") + "<path class=\"choice\" stroke=\"" +
                choice_color(i) + "\" d=\"" + path + "\"><title>" + html_escaped(choice.name) +
                "</title></path>";
    }
    layers.push_back({"layer-choices", "routes to choose from", routes, true});
  }
  const std::string route = path_of(content.plan->route_plan.route.waypoints, frame);
  layers.push_back(
      {"layer-route", "planned route", stroked(route, "casing") + stroked(route, "route"), true});
  const std::string track = track_path(*content.plan, frame);
  layers.push_back({"layer-track", "flown trajectory",
                    stroked(track, "track-casing") + stroked(track, "track"), true});

  // Check boxes before the drawing, so that styles alone can switch its layers.
  std::string html = "<div class=\"map-box\">\n<style>\n";
  for (const Layer& layer : layers) {
    html += "#" + layer.id + ":not(:checked) ~ .frame ." + layer.id + " { display: none; }\n#" +
            layer.id + ":checked ~ .layers label[for=" + layer.id +
            "]::before { content: \"\\2611\\00a0\"; }\n";
  }
  html += "</style>\n";
  for (const Layer& layer : layers) {
    html +=
        "<input type=\"checkbox\" id=\"" + layer.id + "\"" + (layer.is_on ? " checked" : "") + ">";
  }
  html += "\n<div class=\"layers\">";
  for (const Layer& layer : layers) {
    html += "<label for=\"" + layer.id + "\">" + layer.name + "</label>";
  }
  html +=
      "<span class=\"zoom needs-script\"><button type=\"button\" id=\"zoom-in\" "
      "aria-label=\"larger\">+</button><button type=\"button\" id=\"zoom-out\" "
      "aria-label=\"smaller\">\xe2\x88\x92</button><button type=\"button\" id=\"zoom-all\" "
      "aria-label=\"whole map\">\xe2\x97\xbb</button></span>";
  html += "</div>\n<div class=\"frame\"><svg class=\"map\" id=\"map\" viewBox=\"0 0 1000 " +
          fixed_text(frame.height(), 3) +
          "\" role=\"img\" aria-label=\"Map with the planned route and the flown trajectory\">\n" +
          image_of(hillshade_image(map, window, kColumns), frame, "hillshade") + "\n";
  for (const Layer& layer : layers) {
    html += "<g class=\"" + layer.id + "\">" + layer.drawing + "</g>\n";
  }
  html += end_mark(content.plan->route_plan.start, "start", frame) +
          end_mark(content.plan->route_plan.goal, "goal", frame) + scale_bar(content, frame) +
          "<g id=\"marker\" class=\"marker\">" + dot(0, 0, "#000", 16.0) +
          dot(0, 0, "#ff2d2d", 11.0) + "</g></svg>\n";
  html += "</div>\n</div>\n";
  return html + legends(content, frame);
}

}  // namespace hedgehop::output
