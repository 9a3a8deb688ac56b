#include "output/figures.hpp"

#include <array>
#include <cmath>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <gdal_priv.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <memory>
#include <numbers>
#include <sstream>
#include <string>
#include <vector>

#include "base/errors.hpp"
#include "base/files.hpp"
#include "output/gnuplot.hpp"
#include "output/map_images.hpp"
#include "sample_choices.hpp"
#include "sample_plan.hpp"
#include "support/temporary_folder.hpp"

namespace hedgehop::output {
namespace {

namespace fs = std::filesystem;
using testing::HasSubstr;

struct Picture {
  int columns = 0;
  int rows = 0;
  std::vector<unsigned char> bytes;  // red, green, blue

  /// Pixels within 12 of a colour in each channel.
  [[nodiscard]] int count_near(int red, int green, int blue) const {
    int count = 0;
    for (std::size_t i = 0; i + 2 < bytes.size(); i += 3) {
      count += std::abs(bytes[i] - red) <= 12 && std::abs(bytes[i + 1] - green) <= 12 &&
                       std::abs(bytes[i + 2] - blue) <= 12
                   ? 1
                   : 0;
    }
    return count;
  }
};

Picture read_picture(const fs::path& file) {
  GDALAllRegister();
  const std::unique_ptr<GDALDataset> dataset(GDALDataset::Open(file.c_str(), GDAL_OF_RASTER));
  if (dataset == nullptr) {
    ADD_FAILURE() << "no picture " << file;
    return {};
  }
  Picture picture{dataset->GetRasterXSize(), dataset->GetRasterYSize(), {}};
  picture.bytes.resize(static_cast<std::size_t>(picture.columns) *
                       static_cast<std::size_t>(picture.rows) * 3);
  std::array<int, 3> bands = {1, 2, 3};
  EXPECT_EQ(dataset->RasterIO(GF_Read, 0, 0, picture.columns, picture.rows, picture.bytes.data(),
                              picture.columns, picture.rows, GDT_Byte, 3, bands.data(), 3,
                              static_cast<GSpacing>(3) * picture.columns, 1, nullptr),
            CE_None);
  return picture;
}

/// Rows of numbers of a data file.
std::vector<std::vector<double>> numbers_of(const fs::path& file) {
  std::ifstream stream(file);
  std::vector<std::vector<double>> rows;
  for (std::string line; std::getline(stream, line);) {
    if (line.empty() || line[0] == '#') {
      continue;
    }
    std::istringstream words(line);
    std::vector<double> row;
    for (std::string word; words >> word;) {
      row.push_back(std::stod(word));
    }
    rows.push_back(row);
  }
  return rows;
}

bool has_gnuplot() {
  const char* path = std::getenv("PATH");
  std::istringstream folders(path == nullptr ? "" : path);
  for (std::string folder; std::getline(folders, folder, ':');) {
    if (fs::exists(fs::path(folder) / "gnuplot")) {
      return true;
    }
  }
  return false;
}

#define NEEDS_GNUPLOT()                         \
  if (!has_gnuplot()) {                         \
    GTEST_SKIP() << "gnuplot is not installed"; \
  }                                             \
  static_assert(true)

TEST(Figures, EachFigureShowsBothPathsInTheirColours) {
  NEEDS_GNUPLOT();
  const map::Map map = test::make_sample_map();
  const test::TemporaryFolder folder;
  write_figures(test::make_sample_plan(map), map, folder.path() / "figures");
  for (const char* name : {"map", "plan"}) {
    const Picture picture = read_picture(folder.path() / "figures" / (std::string(name) + ".png"));
    EXPECT_GE(picture.columns, 1000);
    EXPECT_GE(picture.rows, 500);
    EXPECT_GT(picture.count_near(0x9b, 0xe5, 0x64), 1000) << "route in " << name;
    EXPECT_GT(picture.count_near(0x5a, 0xc8, 0xff), 1000) << "track in " << name;
    EXPECT_GT(picture.count_near(0xc0, 0x39, 0x2b), 100) << "label in " << name;
  }
  const Picture profile = read_picture(folder.path() / "figures" / "profile.png");
  EXPECT_GT(profile.count_near(0x58, 0xa6, 0x18), 500) << "planned altitude";
  EXPECT_GT(profile.count_near(0x15, 0x83, 0xd0), 2000) << "flown altitude, bank and heading";
  EXPECT_GT(profile.count_near(0xc9, 0xb7, 0x9c), 50000) << "terrain";
  EXPECT_GT(profile.count_near(0xc0, 0x39, 0x2b), 100) << "label";
}

TEST(Figures, RoutesToChooseFromEachHaveTheirColour) {
  NEEDS_GNUPLOT();
  const map::Map map = test::make_sample_map();
  const flight::Plan plan = test::make_sample_plan(map);
  const test::TemporaryFolder folder;
  write_choice_figure(plan, map, test::make_sample_choices(plan), folder.path());
  const Picture picture = read_picture(folder.path() / "alternatives" / "alternatives.png");
  EXPECT_GT(picture.count_near(0x9b, 0xe5, 0x64), 1000) << "main";
  EXPECT_GT(picture.count_near(0xff, 0x5f, 0xa2), 1000) << "hidden";
  EXPECT_GT(picture.count_near(0xff, 0xb0, 0x00), 1000) << "short-cut";
  const std::string script = read_file(folder.path() / "alternatives" / "alternatives.gp");
  EXPECT_THAT(script, HasSubstr("'short-cut'"));
  EXPECT_THAT(script, HasSubstr("11.00 km, seen 421 m, land use 66 m"));
  EXPECT_THAT(script, HasSubstr("'SYNTHETIC REGION'"));
}

TEST(Figures, AttributionAndLabelStandInEachScript) {
  NEEDS_GNUPLOT();
  const map::Map map = test::make_sample_map();
  const test::TemporaryFolder folder;
  write_figures(test::make_sample_plan(map), map, folder.path());
  for (const char* name : {"map.gp", "profile.gp", "plan.gp"}) {
    const std::string script = read_file(folder.path() / name);
    EXPECT_THAT(script, HasSubstr("'SYNTHETIC REGION'")) << name;
    EXPECT_THAT(script, HasSubstr("'Hills made of sines, not a real place'")) << name;
    EXPECT_THAT(script, HasSubstr("NOT VERIFIED (2 violations)")) << name;
  }
}

TEST(Figures, HeadingPassesNorthWithoutAStrokeAcrossTheAxis) {
  NEEDS_GNUPLOT();
  const map::Map map = test::make_sample_map();
  flight::Plan plan = test::make_sample_plan(map);
  // GIVEN a heading that turns right through north, 4 degrees a second
  for (flight::FlightState& state : plan.trajectory.states) {
    state.heading_true_rad = wrap_to_two_pi(radians_from_degrees(300.0 + 4.0 * state.time_s));
    state.target_heading_true_rad = wrap_to_two_pi(state.heading_true_rad + 0.4);
  }
  const double duration_s = plan.trajectory.states.back().time_s;
  // WHEN it is drawn
  const test::TemporaryFolder folder;
  write_figures(plan, map, folder.path());
  // THEN it grows without a jump, and the target stays 0.4 rad ahead
  const auto rows = numbers_of(folder.path() / "heading.dat");
  ASSERT_GT(rows.size(), 100U);
  for (std::size_t i = 0; i < rows.size(); ++i) {
    if (i > 0) {
      EXPECT_LT(std::fabs(rows[i][1] - rows[i - 1][1]), 2.0);
    }
    EXPECT_NEAR(rows[i][2] - rows[i][1], 0.4 * 180.0 / std::numbers::pi, 0.011);
  }
  EXPECT_NEAR(rows.front()[1], 300.0, 0.01);
  EXPECT_NEAR(rows.back()[1], 300.0 + 4.0 * duration_s, 0.02);
}

TEST(Figures, PlannedAltitudeIsPlacedWhereTheFlightPassesNeverBackwards) {
  NEEDS_GNUPLOT();
  const map::Map map = test::make_sample_map();
  const flight::Plan plan = test::make_sample_plan(map);
  const test::TemporaryFolder folder;
  write_figures(plan, map, folder.path());
  const auto planned = numbers_of(folder.path() / "planned.dat");
  const auto flown = numbers_of(folder.path() / "profile.dat");
  ASSERT_EQ(planned.size(), plan.route_plan.route.guide.size());
  for (std::size_t i = 1; i < planned.size(); ++i) {
    EXPECT_GE(planned[i][0], planned[i - 1][0]);
  }
  EXPECT_NEAR(planned.front()[0], 0.0, 0.1);
  EXPECT_NEAR(planned.back()[0], flown.back()[0], 0.1);
}

TEST(Figures, HostileTextsAreDrawnNotRun) {
  NEEDS_GNUPLOT();
  const test::TemporaryFolder folder;
  const fs::path trap = folder.path() / "trap";
  const std::string touch = "touch " + trap.string();
  map::Map map = test::make_sample_map();
  map.label = "'; system('" + touch + "'); '";
  map.attributions = {"`" + touch + "`",
                      "a\n!" + touch + "\nb",
                      "\"; system \"" + touch,
                      "' . system('" + touch + "') . '",
                      "@ %s \\ {/=90 x} \xff\xfe \xc3",
                      std::string(5000, 'x')};
  flight::Plan plan = test::make_sample_plan(map);
  plan.route_plan.config_text = "]] : no yaml `" + touch + "`";
  const fs::path figures = folder.path() / "a folder; $(" / "with 'quotes'\" `";
  write_figures(plan, map, figures);
  EXPECT_TRUE(fs::exists(figures / "plan.png"));
  EXPECT_FALSE(fs::exists(trap));
}

TEST(Figures, UnknownTerrainAndNoVerdictStillGiveFigures) {
  NEEDS_GNUPLOT();
  map::Map map = test::make_sample_map();
  flight::Plan plan = test::make_sample_plan(map);
  const float nan = std::numeric_limits<float>::quiet_NaN();
  for (int row = 0; row < map.geometry.rows; ++row) {
    for (int column = 150; column < 180; ++column) {
      map.surface_m.at(column, row) = nan;
      map.terrain_m.at(column, row) = nan;
    }
  }
  for (std::size_t i = 2000; i < 2400; ++i) {
    plan.trajectory.states[i].surface_m = std::nan("");
    plan.trajectory.states[i].terrain_m = std::nan("");
    plan.trajectory.states[i].target_heading_true_rad = std::nan("");
  }
  plan.verdict.clearance_min_m = std::nan("");
  plan.measures.duration_s = std::nan("");
  const test::TemporaryFolder folder;
  write_figures(plan, map, folder.path());
  EXPECT_THAT(read_file(folder.path() / "map.gp"), HasSubstr("least clearance unknown"));
  EXPECT_TRUE(fs::exists(folder.path() / "plan.png"));
}

TEST(Figures, PlanWithoutAPathOrOnAnotherMapIsRefused) {
  const map::Map map = test::make_sample_map();
  const test::TemporaryFolder folder;
  flight::Plan plan = test::make_sample_plan(map);
  plan.trajectory.states.resize(1);
  EXPECT_THROW(write_figures(plan, map, folder.path()), DataError);
  EXPECT_THROW(write_figures(test::make_sample_plan(map),
                             test::make_map(50, 50, 30.0, [](double, double) { return 100.0; }),
                             folder.path()),
               DataError);
}

TEST(Figures, MissingGnuplotIsASystemFailureWithAHintAndLeavesNoPicture) {
  const map::Map map = test::make_sample_map();
  const test::TemporaryFolder folder;
  const std::string path = std::getenv("PATH");
  ::setenv("PATH", folder.path().c_str(), 1);
  try {
    write_figures(test::make_sample_plan(map), map, folder.path());
    ADD_FAILURE() << "no exception";
  } catch (const SystemFailure& failure) {
    EXPECT_THAT(failure.what(), HasSubstr("gnuplot was not found"));
    EXPECT_THAT(failure.hint(), HasSubstr("gnuplot-nox"));
  }
  ::setenv("PATH", path.c_str(), 1);
  EXPECT_FALSE(fs::exists(folder.path() / "map.png"));
}

TEST(Figures, ScriptThatFailsIsASystemFailureWithGnuplotsWords) {
  NEEDS_GNUPLOT();
  const test::TemporaryFolder folder;
  std::ofstream(folder.path() / "bad.gp") << "plot 'nothing here.dat'\n";
  try {
    run_gnuplot(folder.path(), "bad.gp");
    FAIL() << "no exception";
  } catch (const SystemFailure& failure) {
    EXPECT_THAT(failure.what(), HasSubstr("nothing here.dat"));
  }
}

TEST(GnuplotQuoted, NothingIsLeftThatEndsTheStringOrTheLine) {
  EXPECT_EQ(gnuplot_quoted("it's\n\ta \"test\"", 100), "'it\xe2\x80\x99s  a \"test\"'");
  EXPECT_EQ(gnuplot_quoted("abcdef", 3), "'abc...'");
  EXPECT_EQ(gnuplot_quoted("\xc3\xa4\xff\xc3", 10),
            "'\xc3\xa4?"
            "?'");
}

TEST(MapImages, LitSlopeIsBrighterThanTheSlopeInTheShade) {
  // GIVEN a ridge from south-west to north-east: its north-west side faces the lamp
  const map::Map map = test::make_map(
      100, 100, 30.0, [](double x_m, double y_m) { return 500.0 - 0.3 * std::fabs(y_m - x_m); });
  const Image image = surface_image(map, {0.0, 0.0, 3000.0, 3000.0}, 100);
  ASSERT_EQ(image.rows, 100);
  const auto brightness = [&](int column, int row) {
    const auto at = static_cast<std::size_t>(row * 100 + column) * 3;
    return static_cast<unsigned char>(image.bytes[at]) +
           static_cast<unsigned char>(image.bytes[at + 1]) +
           static_cast<unsigned char>(image.bytes[at + 2]);
  };
  // Mirror places have the same height and tint.
  EXPECT_GT(brightness(35, 65), brightness(65, 35) + 60);
}

TEST(MapImages, VisibilityScaleIsTheRoundTenthAboveNearlyAllCells) {
  map::Map map = test::make_map(100, 100, 30.0, [](double, double) { return 100.0; });
  for (int i = 0; i < 100; ++i) {
    for (int k = 0; k < 100; ++k) {
      map.visibility.at(i, k) = test::stored_visibility(0.0034 * i);
    }
  }
  EXPECT_DOUBLE_EQ(visibility_scale(map, {0.0, 0.0, 3000.0, 3000.0}), 0.4);
  const Image image = visibility_image(map, {0.0, 0.0, 3000.0, 3000.0}, 100, 0.4);
  // Dark on the hidden side, brighter to the east, by the sum of the channels.
  const auto sum = [&](int column) {
    const auto at = static_cast<std::size_t>(50 * 100 + column) * 3;
    return static_cast<unsigned char>(image.bytes[at]) +
           static_cast<unsigned char>(image.bytes[at + 1]) +
           static_cast<unsigned char>(image.bytes[at + 2]);
  };
  EXPECT_LT(sum(0), 20);
  EXPECT_LT(sum(20), sum(60));
  EXPECT_LT(sum(60), sum(99));
}

}  // namespace
}  // namespace hedgehop::output
