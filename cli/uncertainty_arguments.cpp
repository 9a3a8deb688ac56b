#include "uncertainty_arguments.hpp"

#include <CLI/CLI.hpp>
#include <stdexcept>

#include "base/config_reader.hpp"
#include "base/shipped_config.hpp"

namespace hedgehop::cli {

void UncertaintyArguments::add_to(CLI::App& verb) {
  verb.add_option("--dem-error-m", errors.dem_m,
                  "Standard deviation of the surface's error [m]; 0: none")
      ->check(CLI::Range(0.0, 1000.0));
  verb.add_option("--navigation-error-m", errors.navigation_m,
                  "The same of the position along each axis [m]; 0: none")
      ->check(CLI::Range(0.0, 1000.0));
  verb.add_option("--draws", draws, "Errors to draw (default: uncertainty.yaml)")
      ->check(CLI::Range(1, 10000000));
  verb.add_option("--error-seed", seed, "Seed of the errors (default: 1)");
}

evaluation::UncertaintyOptions UncertaintyArguments::options() const {
  ConfigReader reader =
      ConfigReader::from_text(shipped_config("uncertainty.yaml"), "config/uncertainty.yaml");
  evaluation::UncertaintyOptions options = evaluation::read_uncertainty_options(reader);
  if (draws > 0) {
    options.draws = draws;
  }
  return options;
}

std::optional<evaluation::ClearanceRisk> UncertaintyArguments::risk_of(
    const Console& console, const map::Map& map, const flight::Plan& plan) const {
  if (!is_asked_for()) {
    return std::nullopt;
  }
  const double demanded_m =
      clearance_m ? *clearance_m
                  : ConfigReader::from_text(plan.route_plan.config_text, "config of the plan")
                        .required_section("verification")
                        .required_double("required_clearance_m");
  try {
    return evaluation::clearance_risk(map, plan.trajectory, errors, demanded_m, options(), seed);
  } catch (const std::invalid_argument& error) {
    console.say(std::string("no errors drawn: ") + error.what());
    return std::nullopt;
  }
}

}  // namespace hedgehop::cli
