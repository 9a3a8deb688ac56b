#pragma once

#include <functional>
#include <list>
#include <memory>
#include <string>
#include <variant>

#include "base/config_reader.hpp"
#include "base/observer.hpp"
#include "base/time.hpp"
#include "bus/blob_exchange.hpp"
#include "bus/bus.hpp"
#include "bus/map_exchange.hpp"
#include "bus/service.hpp"
#include "flight/plan_request.hpp"
#include "global_planning/global_planner.hpp"
#include "map/map.hpp"
#include "messages/plan_messages.hpp"

namespace hedgehop::services {

/// Config of a planner service.
struct PlannerOptions {
  double tick_period_s = 0.0;    // longest pause between ticks
  double status_period_s = 0.0;  // of PLAN_STATUS while something waits or works
  double patience_s = 0.0;       // in message time: what is missing longer is named on stderr, and
                                 // a question about a map that is not on the bus is refused
  int kept_answers = 0;          // answers that are given again without planning again
  double send_rate_bytesps = 0.0;  // of the process's BlobExchange
};
PlannerOptions read_planner_options(ConfigReader reader);

/// An answer that is ready to be sent, and the blob that holds it.
struct Answer {
  Hash128 blob_id;
  std::function<void()> publish;
};

/// What a planner is asked: everything is there when the map of that hash and the blob `input` are.
struct Question {
  Hash128 request_id;
  Hash128 map_hash;
  messages::BlobRef input;
  std::string input_name;  // "config of the request", "route"
  std::function<std::variant<Answer, flight::NoPlan>(const map::Map& map, const Bytes& input,
                                                     Observer& observer)>
      plan;
};

/// The order book of a planner service: collects what a question needs, plans one question at a
/// time in order of arrival, tells PLAN_STATUS, answers repeated questions without planning again.
///
/// When the map changes while a plan is made on it, the work stops and the question waits for the
/// map that it names; whoever asked for it asks again, for the new one.
///
/// While a plan is made the process stays on the bus: the observer that the planner polls hands
/// messages over every 50 ms, so that chunks are served, progress is told and a cancellation is
/// heard. With a log it does not, so that a replay is a function of the log alone.
class PlannerDesk {
 public:
  PlannerDesk(const PlannerOptions& options, messages::PlanStage stage, bus::Bus& bus,
              bus::BlobExchange& exchange, bus::ServiceLoop& loop);
  ~PlannerDesk();

  // Handlers.
  void receive(const messages::MapIndex& index, const messages::Stamp& stamp);
  /// A new question is queued; a known one is answered again, or tried again if it had been refused
  /// or cancelled.
  void receive(Question question);
  void receive(const messages::PlanCancel& cancel);

  void tick(Time now);

  /// Newest patch in the map that questions are planned on; 0: base map.
  [[nodiscard]] std::int64_t patch_number() const { return assembly_.patch_number(); }

  /// For the status of the question that is being planned.
  void report(const global_planning::RouteProgress& progress);

  /// What keeps the question that is being planned waiting, told at once; empty: nothing any more.
  void hold_up(const std::string& lack);

  /// One line for each question that still waits, with what it lacks. Empty when none waits.
  [[nodiscard]] std::string unanswered() const;

 private:
  struct Job;
  class WorkingObserver;

  [[nodiscard]] bool is_ready(const Job& job) const;
  [[nodiscard]] bool is_superseded(const Job& job) const;
  [[nodiscard]] std::string lack_of(const Job& job) const;
  [[nodiscard]] Job* job_of(const Hash128& request_id);
  void wait(Job& job, Time now);
  bool make_room();
  void cancel(Job& job);
  void give_up(Job& job);
  void work(Job& job);
  void answer_again();
  void publish_status_if_due(Job& job, Time now);
  void publish_status(Job& job, Time now);
  void forget_input(const Job& job);
  void drop_old_answers();

  PlannerOptions options_;
  messages::PlanStage stage_;
  bus::Bus& bus_;
  bus::BlobExchange& exchange_;
  bus::ServiceLoop& loop_;
  bus::MapAssembly assembly_;
  std::list<Job> jobs_;  // in order of arrival; references stay valid while a job is worked on
  Job* working_ = nullptr;
  std::string rival_named_;  // hash of another tiler's map that was told of
  std::string held_up_;      // why the work on it does not go on
};

}  // namespace hedgehop::services
