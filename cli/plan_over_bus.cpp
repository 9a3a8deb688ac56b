#include "plan_over_bus.hpp"

#include <algorithm>
#include <array>
#include <chrono>
#include <cmath>
#include <memory>
#include <optional>

#include "base/errors.hpp"
#include "bus/map_exchange.hpp"
#include "bus/service.hpp"
#include "messages/message_error.hpp"
#include "messages/plan_blobs.hpp"
#include "planning/map_for_plan.hpp"

namespace hedgehop::cli {
namespace {

using messages::PlanStage;
using messages::PlanState;
using messages::Stamp;
using SteadyTime = std::chrono::steady_clock::time_point;

constexpr double kRepeatPeriod_s = 1.0;
constexpr double kRemarkPeriod_s = 5.0;
constexpr int kCancelRepeats = 3;

double seconds_since(SteadyTime time) {
  return std::chrono::duration<double>(std::chrono::steady_clock::now() - time).count();
}

constexpr double kIndexAgeMax_s = 3.0;  // three of them have been missed

}  // namespace

// What has been heard. Handlers outlive their user, so they share it.
struct BusPlanner::Heard {
  Hash128 request_id;
  bus::NewestIndex newest;
  SteadyTime index_time;
  struct Stage {
    std::optional<messages::PlanStatus> status;
    SteadyTime time;
  };
  std::array<Stage, 2> stages;
  std::optional<messages::TrajectoryHeader> trajectory;

  [[nodiscard]] const std::optional<messages::MapIndex>& index() const { return newest.index(); }
  [[nodiscard]] const std::optional<messages::PlanStatus>& status(PlanStage stage) const {
    return stages.at(static_cast<std::size_t>(stage)).status;
  }
  [[nodiscard]] bool is_done(PlanStage stage) const {
    return status(stage) && status(stage)->state == PlanState::kDone;
  }
};

namespace {

using Heard = BusPlanner::Heard;

class Conversation {
 public:
  Conversation(bus::Bus& bus, bus::BlobExchange& exchange, std::shared_ptr<Heard> heard,
               double timeout_s, Observer& observer)
      : bus_(bus),
        exchange_(exchange),
        timeout_s_(timeout_s),
        observer_(observer),
        heard_(std::move(heard)) {}

  std::variant<flight::Plan, flight::NoPlan> run(const flight::PlanRequest& request,
                                                 const std::string& config_text) {
    if (request.via.size() > messages::kMaxVia) {
      throw UsageError("a request over the bus holds at most " + std::to_string(messages::kMaxVia) +
                           " --via places, this one has " + std::to_string(request.via.size()),
                       "`hedgehop plan` takes more");
    }
    heard_->request_id = {};
    find_map();
    messages::PlanRequestMessage message;
    message.request = request;
    message.config = exchange_.offer(messages::encode_planning_config(config_text), true);
    const bool weighs_threats = planning::weighs_threats(config_text);
    const auto newest_hash = [&] { return heard_->index()->hash_for(weighs_threats); };
    const auto begin = [&] {
      message.map_hash = newest_hash();
      message.request_id = flight::plan_request_id(request, message.map_hash, config_text);
      heard_->request_id = message.request_id;
      heard_->stages = {};
      heard_->trajectory.reset();
      route_done_.reset();
      missing_ = -1;
      begin_ = std::chrono::steady_clock::now();
    };
    begin();
    std::optional<SteadyTime> asked;
    while (true) {
      if (newest_hash() != message.map_hash) {
        observer_.note("the map has changed, patch " +
                       std::to_string(heard_->index()->patch_number) + ": planning again");
        cancel();
        begin();
        asked.reset();
      }
      if (!asked || seconds_since(*asked) > kRepeatPeriod_s) {
        asked = std::chrono::steady_clock::now();
        bus_.publish(messages::kPlanRequestChannel, message, bus_.now());
      }
      turn();
      if (newest_hash() != message.map_hash) {
        continue;
      }
      if (auto no_plan = answer_without_plan()) {
        return std::move(*no_plan);
      }
      show_progress();
      if (auto plan = collect()) {
        plan->route_plan.map.patch_number = heard_->trajectory->patch_number;
        return std::move(*plan);
      }
      check_silence();
    }
  }

 private:
  void turn() {
    bus_.poll(std::min(0.05, exchange_.next_tick_s(bus_.now())));
    exchange_.tick(bus_.now());
    if (!observer_.stop_requested()) {
      return;
    }
    if (!heard_->request_id.is_zero()) {
      cancel();
    }
    throw Interrupted();
  }

  void cancel() {
    for (int i = 0; i < kCancelRepeats; ++i) {
      bus_.publish(messages::kPlanCancelChannel, messages::PlanCancel{heard_->request_id},
                   bus_.now());
    }
  }

  void find_map() {
    begin_ = std::chrono::steady_clock::now();
    bus_.poll(0.0);  // what has come since the last plan
    while (!heard_->index() || seconds_since(heard_->index_time) > kIndexAgeMax_s) {
      turn();
      if (seconds_since(begin_) > timeout_s_) {
        throw BusError("no map on the bus: no map_tiler heard on " + bus_.url() + " within " +
                           seconds_text(timeout_s_),
                       "start the services with `hedgehop serve --map MAP`, with the same "
                       "--lcm-url and --channel-prefix; `hedgehop watch` shows who is there");
      }
    }
  }

  std::optional<flight::NoPlan> answer_without_plan() {
    for (const Heard::Stage& stage : heard_->stages) {
      if (!stage.status) {
        continue;
      }
      const messages::PlanStatus& status = *stage.status;
      const std::string who = name_of(status.stage);
      switch (status.state) {
        case PlanState::kNoPlan:
          return status.no_plan;
        case PlanState::kRefused:
          throw UserError(ExitCode::kFailure, who + " refuses the request: " + status.text,
                          "`hedgehop watch` shows the state of the services");
        case PlanState::kCancelled:
          throw UserError(ExitCode::kInterrupted, who + " gave the request up: " + status.text,
                          "ask again");
        default:
          break;
      }
    }
    return std::nullopt;
  }

  void show_progress() {
    const bool is_flying = heard_->is_done(PlanStage::kGlobal);
    const auto& status = heard_->status(is_flying ? PlanStage::kLocal : PlanStage::kGlobal);
    if (!status) {
      return;
    }
    if (status->state == PlanState::kWorking && status->work_budget > 0) {
      const std::string stage = is_flying && !status->text.empty() ? status->text
                                : is_flying                        ? "flying the route"
                                                                   : "planning the route";
      observer_.progress(stage, static_cast<double>(status->work_units),
                         static_cast<double>(status->work_budget));
    } else if (status->state == PlanState::kWaiting && seconds_since(begin_) > kRemarkPeriod_s &&
               (!remarked_ || seconds_since(*remarked_) > kRemarkPeriod_s)) {
      remarked_ = std::chrono::steady_clock::now();
      observer_.note(name_of(status->stage) + " is " + status->text);
    }
  }

  std::optional<flight::Plan> collect() {
    if (!heard_->trajectory) {
      return std::nullopt;
    }
    const messages::TrajectoryHeader& header = *heard_->trajectory;
    if (const auto why = bus::reason_against_provenance(header.provenance); !why.empty()) {
      throw DataError("the trajectory cannot be used: " + why,
                      "install one version everywhere; `hedgehop watch` shows who is there");
    }
    exchange_.want(header.route, "route");
    exchange_.want(header.plan, "trajectory");
    const Bytes* route = exchange_.content(header.route.id);
    const Bytes* plan = exchange_.content(header.plan.id);
    const std::int64_t missing = exchange_.missing_chunk_count();
    if (missing != missing_) {
      missing_ = missing;
      collected_ = std::chrono::steady_clock::now();
    }
    if (route == nullptr || plan == nullptr) {
      return std::nullopt;
    }
    try {
      const flight::RoutePlan route_plan = messages::decode_route_plan(*route);
      if (route_plan.request_id != heard_->request_id) {
        throw messages::MessageError("the route answers another request");
      }
      flight::Plan whole = messages::decode_flight_plan(*plan, route_plan, header.route.id);
      exchange_.forget(header.route.id);
      exchange_.forget(header.plan.id);
      return whole;
    } catch (const messages::MessageError& error) {
      throw DataError(
          std::string("the plan that came over the bus cannot be used: ") + error.what(),
          "services and this program differ in version; `hedgehop watch` shows them");
    }
  }

  void check_silence() const {
    const double silence_max_s = 3.0 * timeout_s_;
    const auto& global = heard_->stages[static_cast<std::size_t>(PlanStage::kGlobal)];
    const auto& local = heard_->stages[static_cast<std::size_t>(PlanStage::kLocal)];
    const auto fail = [&](const std::string& what) {
      throw BusError(what,
                     "`hedgehop watch` shows which services are there; `hedgehop serve` "
                     "starts them all");
    };
    if (heard_->trajectory) {
      if (seconds_since(collected_) > silence_max_s) {
        fail("the trajectory is there, but " + std::to_string(missing_) +
             " of its chunks do not come");
      }
      return;
    }
    if (!heard_->is_done(PlanStage::kGlobal)) {
      if (!global.status && seconds_since(begin_) > timeout_s_) {
        fail("map_tiler is on the bus, but no global_planner answered within " +
             seconds_text(timeout_s_));
      }
      if (global.status && seconds_since(global.time) > silence_max_s) {
        fail("global_planner has said nothing for " + seconds_text(silence_max_s));
      }
      return;
    }
    if (!local.status && seconds_since(first_done()) > timeout_s_) {
      fail("the route is planned, but no local_planner answered within " +
           seconds_text(timeout_s_));
    }
    if (local.status && seconds_since(local.time) > silence_max_s) {
      fail("local_planner has said nothing for " + seconds_text(silence_max_s));
    }
  }

  // When the route was first heard to be there; later statuses only repeat it.
  SteadyTime first_done() const {
    if (!route_done_) {
      route_done_ = std::chrono::steady_clock::now();
    }
    return *route_done_;
  }

  static std::string name_of(PlanStage stage) {
    return stage == PlanStage::kGlobal ? "global_planner" : "local_planner";
  }
  static std::string seconds_text(double seconds) {
    char text[32];
    std::snprintf(text, sizeof text, "%.3g s", seconds);
    return text;
  }

  bus::Bus& bus_;
  bus::BlobExchange& exchange_;
  const double timeout_s_;
  Observer& observer_;
  std::shared_ptr<Heard> heard_;
  SteadyTime begin_;
  std::optional<SteadyTime> remarked_;
  mutable std::optional<SteadyTime> route_done_;
  std::int64_t missing_ = -1;
  SteadyTime collected_;
};

}  // namespace

BusPlanner::BusPlanner(bus::Bus& bus, bus::BlobExchange& exchange)
    : bus_(bus), exchange_(exchange), heard_(std::make_shared<Heard>()) {
  bus.subscribe<messages::MapIndex>(
      messages::kMapIndexChannel,
      [heard = heard_](const messages::MapIndex& index, const Stamp& stamp) {
        heard->newest.hear(index, stamp.sender_id);
        heard->index_time = std::chrono::steady_clock::now();
      });
  bus.subscribe<messages::PlanStatus>(
      messages::kPlanStatusChannel,
      [heard = heard_](const messages::PlanStatus& status, const Stamp&) {
        if (status.request_id == heard->request_id) {
          auto& stage = heard->stages.at(static_cast<std::size_t>(status.stage));
          stage.status = status;
          stage.time = std::chrono::steady_clock::now();
        }
      });
  bus.subscribe<messages::TrajectoryHeader>(
      messages::kTrajectoryChannel,
      [heard = heard_](const messages::TrajectoryHeader& trajectory, const Stamp&) {
        if (trajectory.request_id == heard->request_id) {
          heard->trajectory = trajectory;
        }
      });
}

std::variant<flight::Plan, flight::NoPlan> BusPlanner::plan(const flight::PlanRequest& request,
                                                            const std::string& config_text,
                                                            double timeout_s, Observer& observer) {
  return Conversation(bus_, exchange_, heard_, timeout_s, observer).run(request, config_text);
}

}  // namespace hedgehop::cli
