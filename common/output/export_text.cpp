// Formats that are plain text: KML, GPX, CSV, waypoint lists.
#include <algorithm>
#include <array>
#include <charconv>
#include <cmath>
#include <cstdio>
#include <string_view>

#include "base/angles.hpp"
#include "output/export_writers.hpp"
#include "output/plan_bundle.hpp"

namespace hedgehop::output {
namespace {

std::string fixed(double value, int decimals) {
  std::array<char, 48> buffer{};
  std::snprintf(buffer.data(), buffer.size(), "%.*f", decimals, value);
  return buffer.data();
}

// Bytes of a well-formed UTF-8 character at the beginning of a text, 0 if there is none.
std::size_t character_bytes(std::string_view text) {
  const auto byte = [&](std::size_t i) { return static_cast<unsigned char>(text[i]); };
  const unsigned char first = byte(0);
  const std::size_t count = first < 0x80U                     ? 1
                            : first >= 0xC2U && first < 0xE0U ? 2
                            : first >= 0xE0U && first < 0xF0U ? 3
                            : first >= 0xF0U && first < 0xF5U ? 4
                                                              : 0;
  if (count == 0 || count > text.size()) {
    return 0;
  }
  for (std::size_t i = 1; i < count; ++i) {
    if ((byte(i) & 0xC0U) != 0x80U) {
      return 0;
    }
  }
  // Overlong forms, surrogates, beyond the last code point, and two that XML does not allow.
  const unsigned char second = count > 1 ? byte(1) : 0;
  const bool is_wrong = (first == 0xE0U && second < 0xA0U) || (first == 0xEDU && second > 0x9FU) ||
                        (first == 0xF0U && second < 0x90U) || (first == 0xF4U && second > 0x8FU) ||
                        (first == 0xEFU && second == 0xBFU && byte(2) >= 0xBEU);
  return is_wrong ? 0 : count;
}

// Text for XML: markup escaped, control characters as spaces, broken UTF-8 as question marks.
std::string xml(std::string_view text) {
  std::string escaped;
  while (!text.empty()) {
    const std::size_t count = character_bytes(text);
    if (count == 0) {
      escaped += '?';
    } else if (count > 1) {
      escaped += text.substr(0, count);
    } else {
      switch (const char c = text.front()) {
        case '&':
          escaped += "&amp;";
          break;
        case '<':
          escaped += "&lt;";
          break;
        case '>':
          escaped += "&gt;";
          break;
        case '"':
          escaped += "&quot;";
          break;
        default:
          escaped += static_cast<unsigned char>(c) < 0x20U || c == 0x7F ? ' ' : c;
      }
    }
    text.remove_prefix(std::max<std::size_t>(count, 1));
  }
  return escaped;
}

std::string joined_lines(const flight::Plan& plan) {
  std::string text;
  for (const std::string& line : product_lines(plan)) {
    text += (text.empty() ? "" : "; ") + line;
  }
  return xml(text);
}

}  // namespace

std::string kml_text(const flight::Plan& plan, Places& places, const ExportRequest& request,
                     const ExportOptions& options) {
  const auto numbers = [&](double x_m, double y_m, double altitude_m, char separator) {
    const Places::Degrees p = places.degrees({x_m, y_m});
    return fixed(p.longitude_deg, 9) + separator + fixed(p.latitude_deg, 9) + separator +
           fixed(places.amsl_m({x_m, y_m}, altitude_m), 3);
  };
  std::string text =
      "<?xml version=\"1.0\" encoding=\"UTF-8\"?>\n"
      "<kml xmlns=\"http://www.opengis.net/kml/2.2\" "
      "xmlns:gx=\"http://www.google.com/kml/ext/2.2\">\n"
      "<Document>\n"
      "<name>hedgehop flight</name>\n"
      "<description>" +
      joined_lines(plan) +
      "; altitudes above mean sea level (EGM96)</description>\n"
      "<Style id=\"route\"><LineStyle><color>ff00a5ff</color><width>2</width></LineStyle></Style>\n"
      "<Style id=\"flight\"><LineStyle><color>ffff5500</color><width>3</width></LineStyle>"
      "<PolyStyle><color>40ff5500</color></PolyStyle></Style>\n";

  const std::vector<flight::FlightState> track = thinned(plan.trajectory, options.track_step_s);
  text +=
      "<Placemark><name>Flight</name><styleUrl>#flight</styleUrl>\n"
      "<LineString><extrude>1</extrude><altitudeMode>absolute</altitudeMode><coordinates>\n";
  for (const flight::FlightState& state : track) {
    text += numbers(state.x_m, state.y_m, state.altitude_m, ',') + "\n";
  }
  text += "</coordinates></LineString></Placemark>\n";

  text +=
      "<Placemark><name>Planned route</name><styleUrl>#route</styleUrl>\n"
      "<LineString><altitudeMode>absolute</altitudeMode><coordinates>\n";
  const auto& waypoints = plan.route_plan.route.waypoints;
  for (const flight::Waypoint& waypoint : waypoints) {
    text += numbers(waypoint.x_m, waypoint.y_m, waypoint.altitude_m, ',') + "\n";
  }
  text += "</coordinates></LineString></Placemark>\n";

  if (request.start_time) {
    text +=
        "<Placemark><name>Flight over time</name><styleUrl>#flight</styleUrl>\n"
        "<gx:Track><altitudeMode>absolute</altitudeMode>\n";
    for (const flight::FlightState& state : track) {
      text += "<when>" + time_text(request.start_time, state.time_s) + "</when>\n";
    }
    for (const flight::FlightState& state : track) {
      text += "<gx:coord>" + numbers(state.x_m, state.y_m, state.altitude_m, ' ') + "</gx:coord>\n";
    }
    for (const flight::FlightState& state : track) {
      // Heading, tilt and roll in degrees, as in an orientation of a model.
      text += "<gx:angles>" + fixed(degrees_from_radians(state.heading_true_rad), 3) + " " +
              fixed(degrees_from_radians(state.pitch_rad), 3) + " " +
              fixed(degrees_from_radians(state.bank_rad), 3) + "</gx:angles>\n";
    }
    text += "</gx:Track></Placemark>\n";
  }

  text += "<Folder><name>Waypoints of the route</name>\n";
  for (std::size_t i = 0; i < waypoints.size(); ++i) {
    text += "<Placemark><name>" + std::to_string(i) +
            "</name><Point><altitudeMode>absolute</altitudeMode><coordinates>" +
            numbers(waypoints[i].x_m, waypoints[i].y_m, waypoints[i].altitude_m, ',') +
            "</coordinates></Point></Placemark>\n";
  }
  text += "</Folder>\n";
  const auto add_end = [&](const char* name, const flight::FlightState& state) {
    text += std::string("<Placemark><name>") + name + "</name>";
    if (request.start_time) {
      text +=
          "<TimeStamp><when>" + time_text(request.start_time, state.time_s) + "</when></TimeStamp>";
    }
    text += "<Point><extrude>1</extrude><altitudeMode>absolute</altitudeMode><coordinates>" +
            numbers(state.x_m, state.y_m, state.altitude_m, ',') +
            "</coordinates></Point></Placemark>\n";
  };
  add_end("Start", plan.trajectory.states.front());
  add_end("Goal", plan.trajectory.states.back());
  return text + "</Document>\n</kml>\n";
}

std::string gpx_text(const flight::Plan& plan, Places& places, const ExportRequest& request,
                     const ExportOptions& options) {
  const auto point = [&](const char* tag, double x_m, double y_m, double altitude_m,
                         const std::string& more) {
    const Places::Degrees p = places.degrees({x_m, y_m});
    return std::string("<") + tag + " lat=\"" + fixed(p.latitude_deg, 9) + "\" lon=\"" +
           fixed(p.longitude_deg, 9) + "\"><ele>" +
           fixed(places.amsl_m({x_m, y_m}, altitude_m), 3) + "</ele>" + more + "</" + tag + ">\n";
  };
  std::string text =
      "<?xml version=\"1.0\" encoding=\"UTF-8\"?>\n"
      "<gpx version=\"1.1\" creator=\"hedgehop\" xmlns=\"http://www.topografix.com/GPX/1/1\">\n"
      "<metadata><name>hedgehop flight</name><desc>" +
      joined_lines(plan) + "; ele above mean sea level (EGM96)</desc>";
  if (request.start_time) {
    text += "<time>" + time_text(request.start_time, 0.0) + "</time>";
  }
  text += "</metadata>\n<rte><name>Planned route</name>\n";
  const auto& waypoints = plan.route_plan.route.waypoints;
  for (std::size_t i = 0; i < waypoints.size(); ++i) {
    text += point("rtept", waypoints[i].x_m, waypoints[i].y_m, waypoints[i].altitude_m,
                  "<name>" + std::to_string(i) + "</name>");
  }
  text += "</rte>\n<trk><name>Flight</name><trkseg>\n";
  for (const flight::FlightState& state : thinned(plan.trajectory, options.track_step_s)) {
    const std::string time = time_text(request.start_time, state.time_s);
    text += point("trkpt", state.x_m, state.y_m, state.altitude_m,
                  time.empty() ? "" : "<time>" + time + "</time>");
  }
  return text + "</trkseg></trk>\n</gpx>\n";
}

std::string csv_text(const flight::Plan& plan, const ExportRequest& request) {
  const std::string table = trajectory_csv(plan);
  if (!request.start_time) {
    return table;
  }
  std::string text;
  text.reserve(table.size() + plan.trajectory.states.size() * 26);
  std::string_view rest = table;
  std::size_t row = 0;
  while (!rest.empty()) {
    const std::size_t end = rest.find('\n');
    text += rest.substr(0, end);
    text += ',';
    text += row == 0 ? "time_utc"
                     : time_text(request.start_time, plan.trajectory.states[row - 1].time_s);
    text += '\n';
    rest.remove_prefix(end + 1);
    ++row;
  }
  return text;
}

std::string wpl_text(const WaypointList& list) {
  // index, current, frame, command, four parameters, latitude, longitude, altitude, autocontinue
  std::string text = "QGC WPL 110\n";
  std::size_t index = 0;
  const auto add = [&](int frame, int command, const std::string& parameters,
                       const Places::Degrees& place, double amsl_m) {
    text += std::to_string(index) + "\t" + (index == 0 ? "1" : "0") + "\t" + std::to_string(frame) +
            "\t" + std::to_string(command) + "\t" + parameters + "\t" +
            fixed(place.latitude_deg, 9) + "\t" + fixed(place.longitude_deg, 9) + "\t" +
            fixed(amsl_m, 3) + "\t1\n";
    ++index;
  };
  constexpr int kGlobalAmsl = 0;     // MAV_FRAME_GLOBAL
  constexpr int kNoPlace = 2;        // MAV_FRAME_MISSION
  constexpr int kWaypoint = 16;      // MAV_CMD_NAV_WAYPOINT
  constexpr int kChangeSpeed = 178;  // MAV_CMD_DO_CHANGE_SPEED: 1 = ground speed, m/s, throttle
  add(kGlobalAmsl, kWaypoint, "0\t0\t0\t0", list.home, list.home_amsl_m);
  for (const MissionItem& item : list.items) {
    if (item.is_speed) {
      add(kNoPlace, kChangeSpeed, "1\t" + fixed(item.speed_mps, 1) + "\t-1\t0", {0.0, 0.0}, 0.0);
    } else {
      add(kGlobalAmsl, kWaypoint, "0\t0\t0\t0", item.place, item.amsl_m);
    }
  }
  return text;
}

}  // namespace hedgehop::output
