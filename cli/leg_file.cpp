#include "leg_file.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <nlohmann/json.hpp>
#include <optional>
#include <sstream>
#include <string>

#include "base/angles.hpp"
#include "base/errors.hpp"
#include "base/files.hpp"
#include "geo/map_projection.hpp"
#include "geo/vertical_datum.hpp"

namespace hedgehop::cli {
namespace {

constexpr std::uintmax_t kBytesMax = 64U << 20U;
constexpr std::size_t kItemsMax = 100'000;
constexpr int kFrameAmsl = 0;           // MAV_FRAME_GLOBAL
constexpr int kWaypoint = 16;           // MAV_CMD_NAV_WAYPOINT
constexpr int kFirstWithoutPlace = 93;  // MAV_CMD_NAV_DELAY; what follows says when and how
constexpr std::array<int, 4> kWithPlace = {189, 195, 201, 530};  // landings, regions of interest
constexpr double kAround_deg = 0.01;  // of the waypoints, for the choice of a geoid grid
constexpr char kListHeader[] = "QGC WPL 110";

struct Item {
  std::size_t number = 0;
  int command = 0;
  int frame = 0;
  double latitude_deg = std::numeric_limits<double>::quiet_NaN();
  double longitude_deg = std::numeric_limits<double>::quiet_NaN();
  double altitude_m = std::numeric_limits<double>::quiet_NaN();
};

[[noreturn]] void refuse(const std::string& file, const std::string& why,
                         const std::string& hint = "give a file as hedgehop export writes it") {
  throw DataError(file + ": " + why, hint);
}

std::vector<Item> items_of_list(const std::string& text, const std::string& file) {
  std::vector<Item> items;
  std::istringstream lines(text);
  std::string line;
  std::getline(lines, line);
  while (std::getline(lines, line)) {
    if (line.find_first_not_of(" \t\r") == std::string::npos) {
      continue;
    }
    std::istringstream fields(line);
    fields.imbue(std::locale::classic());
    std::array<double, 12> values{};
    for (double& value : values) {
      if (!(fields >> value)) {
        refuse(file, "item " + std::to_string(items.size()) + " has not 12 numbers");
      }
    }
    const auto whole = [&](std::size_t field) {
      if (!(values[field] >= 0.0 && values[field] <= 65535.0)) {
        refuse(file, "item " + std::to_string(items.size()) + " has no frame or command");
      }
      return static_cast<int>(values[field]);
    };
    items.push_back({items.size(), whole(3), whole(2), values[8], values[9], values[10]});
    if (items.size() > kItemsMax) {
      refuse(file, "has more than " + std::to_string(kItemsMax) + " items");
    }
  }
  if (!items.empty()) {
    items.erase(items.begin());  // home
  }
  return items;
}

std::vector<Item> items_of_plan(const std::string& text, const std::string& file) {
  std::vector<Item> items;
  try {
    const auto json = nlohmann::json::parse(text);
    const auto& list = json.at("mission").at("items");
    if (!list.is_array() || list.size() > kItemsMax) {
      refuse(file, "mission.items is no list of at most " + std::to_string(kItemsMax));
    }
    for (const auto& entry : list) {
      Item item;
      item.number = items.size() + 1;
      if (entry.at("type").get<std::string>() != "SimpleItem") {
        refuse(file, "item " + std::to_string(item.number) +
                         " is a pattern, whose legs only the ground station knows");
      }
      item.command = entry.at("command").get<int>();
      item.frame = entry.at("frame").get<int>();
      const auto& parameters = entry.at("params");
      const auto number = [&](std::size_t index) {
        const auto& value = parameters.at(index);
        return value.is_number() ? value.get<double>() : std::numeric_limits<double>::quiet_NaN();
      };
      item.latitude_deg = number(4);
      item.longitude_deg = number(5);
      item.altitude_m = number(6);
      items.push_back(item);
    }
  } catch (const nlohmann::json::exception& error) {
    refuse(file, std::string("is no plan of QGroundControl: ") + error.what());
  }
  return items;
}

bool has_place(const Item& item, const std::string& file) {
  if (item.command >= kFirstWithoutPlace &&
      std::count(kWithPlace.begin(), kWithPlace.end(), item.command) == 0) {
    return false;
  }
  const std::string who = "item " + std::to_string(item.number);
  if (item.command != kWaypoint) {
    refuse(file,
           who + " is command " + std::to_string(item.command) +
               ", which is not flown as a straight leg",
           "leave it out: only waypoints (command 16) can be checked");
  }
  if (item.frame != kFrameAmsl) {
    refuse(file,
           who + " counts heights in frame " + std::to_string(item.frame) +
               ", not above mean sea level",
           "choose absolute heights (frame 0) in the ground station");
  }
  if (!(std::fabs(item.latitude_deg) <= 90.0 && std::fabs(item.longitude_deg) <= 180.0 &&
        std::fabs(item.altitude_m) <= 100000.0)) {
    refuse(file, who + " has no place on earth");
  }
  return true;
}

}  // namespace

std::vector<flight::Waypoint> read_leg_file(const std::filesystem::path& path,
                                            const map::Map& map) {
  const std::string file = path.string();
  std::error_code error;
  if (std::filesystem::file_size(path, error) > kBytesMax || error) {
    refuse(file, "cannot be read, or is too large");
  }
  const std::string text = read_file(path);
  std::vector<Item> items =
      text.starts_with(kListHeader) ? items_of_list(text, file) : items_of_plan(text, file);
  std::erase_if(items, [&](const Item& item) { return !has_place(item, file); });

  const geo::MapProjection projection(map.crs_wkt);
  const geo::VerticalDatum from = geo::VerticalDatum::parse("EGM96");
  const geo::VerticalDatum to = geo::VerticalDatum::parse(map.vertical_datum);
  std::optional<geo::VerticalShift> shift;
  std::vector<flight::Waypoint> waypoints;
  for (const Item& item : items) {
    const geo::GeodeticPosition position{radians_from_degrees(item.latitude_deg),
                                         radians_from_degrees(item.longitude_deg)};
    double shift_m = 0.0;
    if (!(from == to)) {
      if (!shift) {
        const auto [south, north] = std::minmax_element(
            items.begin(), items.end(),
            [](const Item& a, const Item& b) { return a.latitude_deg < b.latitude_deg; });
        const auto [west, east] = std::minmax_element(
            items.begin(), items.end(),
            [](const Item& a, const Item& b) { return a.longitude_deg < b.longitude_deg; });
        shift.emplace(from, to,
                      geo::GeodeticBox{radians_from_degrees(west->longitude_deg - kAround_deg),
                                       radians_from_degrees(south->latitude_deg - kAround_deg),
                                       radians_from_degrees(east->longitude_deg + kAround_deg),
                                       radians_from_degrees(north->latitude_deg + kAround_deg)});
      }
      shift_m = shift->at_m(position);
      if (std::isnan(shift_m)) {
        refuse(file, "the geoid grid between " + from.name + " and " + to.name +
                         " knows nothing at item " + std::to_string(item.number));
      }
    }
    const geo::MapPoint point = projection.to_map(position);
    waypoints.push_back({point.x_m, point.y_m, item.altitude_m + shift_m});
  }
  return waypoints;
}

}  // namespace hedgehop::cli
