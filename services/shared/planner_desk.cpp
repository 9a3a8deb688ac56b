#include "planner_desk.hpp"

#include <algorithm>
#include <atomic>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <mutex>
#include <thread>

#include "base/errors.hpp"
#include "messages/message_error.hpp"

namespace hedgehop::services {
namespace {

using messages::PlanState;

constexpr double kTurnPeriod_s = 0.05;
constexpr int kWaitingMax = 256;

std::string map_text(const messages::MapIndex& index) {
  return "map " + index.map_hash.hex() + " (patch " + std::to_string(index.patch_number) + ")";
}

std::string short_id(const Hash128& id) { return id.hex().substr(0, 8); }

}  // namespace

PlannerOptions read_planner_options(ConfigReader reader) {
  PlannerOptions options;
  options.tick_period_s = reader.required_double("tick_period_s");
  options.status_period_s = reader.required_double("status_period_s");
  options.patience_s = reader.required_double("patience_s");
  options.kept_answers = static_cast<int>(reader.required_integer("kept_answers"));
  options.send_rate_bytesps = reader.required_double("send_rate_bytesps");
  reader.finish();
  reader.require(options.send_rate_bytesps >= 1e4 && options.send_rate_bytesps <= 1e9,
                 "send_rate_bytesps", "must lie between 1e4 and 1e9");
  reader.require(options.tick_period_s >= 0.001 && options.tick_period_s <= 1.0, "tick_period_s",
                 "must lie between 0.001 and 1");
  reader.require(options.status_period_s >= 0.01 && options.status_period_s <= 2.0,
                 "status_period_s", "must lie between 0.01 and 2");
  reader.require(options.patience_s > 0.0 && options.patience_s <= 3600.0, "patience_s",
                 "must lie between 0 and 3600");
  reader.require(options.kept_answers >= 1 && options.kept_answers <= 1000, "kept_answers",
                 "must lie between 1 and 1000");
  return options;
}

struct PlannerDesk::Job {
  Question question;
  messages::PlanStatus status;
  Time asked;  // newest message time when it was asked
  bool is_lack_named = false;
  bool is_asked_again = false;
  bool is_cancelled = false;
  bool is_wanted_after_all = false;  // asked again before the cancellation took effect
  Time next_status;
  Answer answer;

  [[nodiscard]] bool is_over() const {
    return status.state != PlanState::kWaiting && status.state != PlanState::kWorking;
  }
};

// Planners may report from several threads; only the one that drives the bus serves it.
class PlannerDesk::WorkingObserver final : public Observer {
 public:
  WorkingObserver(PlannerDesk& desk, Job& job, bool stays_on_bus)
      : desk_(desk), job_(job), stays_on_bus_(stays_on_bus) {}

  void progress(std::string_view stage, double done, double total) override {
    {
      const std::lock_guard lock(mutex_);
      stage_ = stage;
      done_share_ = total > 0.0 ? done / total : 0.0;
    }
    serve();
  }
  void note(std::string_view text) override {
    const std::lock_guard lock(mutex_);
    std::fprintf(stderr, "note: %.*s\n", static_cast<int>(text.size()), text.data());
  }
  [[nodiscard]] bool stop_requested() const override {
    serve();
    return bus::stop_requested() || is_given_up_.load(std::memory_order_relaxed);
  }

 private:
  void serve() const {
    if (!stays_on_bus_ || std::this_thread::get_id() != owner_ || is_serving_) {
      return;
    }
    const auto now = std::chrono::steady_clock::now();
    if (std::chrono::duration<double>(now - served_).count() < kTurnPeriod_s) {
      return;
    }
    is_serving_ = true;
    desk_.loop_.turn(0.0, [this](Time time) {
      if (desk_.stage_ == messages::PlanStage::kLocal) {  // it has no work units of its own
        const std::lock_guard lock(mutex_);
        job_.status.text = desk_.held_up_.empty() ? stage_ : desk_.held_up_;
        job_.status.work_units = std::llround(1000.0 * done_share_);
        job_.status.work_budget = 1000;
      }
      desk_.publish_status_if_due(job_, time);
      desk_.answer_again();
    });
    is_given_up_ = job_.is_cancelled || desk_.is_superseded(job_);
    served_ = std::chrono::steady_clock::now();
    is_serving_ = false;
  }

  PlannerDesk& desk_;
  Job& job_;
  const bool stays_on_bus_;
  const std::thread::id owner_ = std::this_thread::get_id();
  mutable std::chrono::steady_clock::time_point served_;
  mutable bool is_serving_ = false;
  mutable std::atomic<bool> is_given_up_{false};
  mutable std::mutex mutex_;
  std::string stage_;
  double done_share_ = 0.0;
};

PlannerDesk::PlannerDesk(const PlannerOptions& options, messages::PlanStage stage, bus::Bus& bus,
                         bus::BlobExchange& exchange, bus::ServiceLoop& loop)
    : options_(options),
      stage_(stage),
      bus_(bus),
      exchange_(exchange),
      loop_(loop),
      assembly_(exchange) {}

PlannerDesk::~PlannerDesk() = default;

PlannerDesk::Job* PlannerDesk::job_of(const Hash128& request_id) {
  for (Job& job : jobs_) {
    if (job.question.request_id == request_id) {
      return &job;
    }
  }
  return nullptr;
}

void PlannerDesk::receive(const messages::MapIndex& index, const messages::Stamp& stamp) {
  assembly_.receive(index, stamp.sender_id);
  const auto& rival = assembly_.rival();
  const std::string named = rival ? rival->map_hash.hex() : std::string();
  if (named == rival_named_) {
    return;
  }
  rival_named_ = named;
  if (working_ == nullptr && !rival) {
    loop_.set_state(messages::ServiceState::kReady, {});
  } else if (rival) {
    const std::string what = "two maps on the bus: " + map_text(*assembly_.index()) +
                             ", which counts, and " + map_text(*rival);
    std::fprintf(stderr, "warning: %s\n", what.c_str());
    loop_.set_state(messages::ServiceState::kDegraded, what);
  }
}

void PlannerDesk::receive(Question question) {
  Job* job = job_of(question.request_id);
  if (job != nullptr && job->status.state != PlanState::kRefused &&
      job->status.state != PlanState::kCancelled) {
    (job->is_cancelled ? job->is_wanted_after_all : job->is_asked_again) = true;
    return;
  }
  if (job != nullptr) {
    jobs_.remove_if([&](const Job& other) { return &other == job; });
  }
  if (std::count_if(jobs_.begin(), jobs_.end(),
                    [](const Job& other) { return !other.is_over(); }) >= kWaitingMax &&
      !make_room()) {
    messages::PlanStatus status;
    status.request_id = question.request_id;
    status.stage = stage_;
    status.state = PlanState::kRefused;
    status.text = std::to_string(kWaitingMax) + " requests wait already; ask again later";
    bus_.publish(messages::kPlanStatusChannel, status, bus_.now());
    return;
  }
  Job& added = jobs_.emplace_back();
  added.status.request_id = question.request_id;
  added.status.stage = stage_;
  added.question = std::move(question);
  added.asked = bus_.message_time();
  try {
    exchange_.want(added.question.input, added.question.input_name);
  } catch (const messages::MessageError& error) {
    added.status.state = PlanState::kRefused;
    added.status.text = error.what();
    added.is_asked_again = true;
  }
}

// Questions that lack something give way, the oldest first, so that nonsense cannot fill the book.
bool PlannerDesk::make_room() {
  const auto idle = std::find_if(jobs_.begin(), jobs_.end(), [&](const Job& job) {
    return job.status.state == PlanState::kWaiting && !is_ready(job);
  });
  if (idle == jobs_.end()) {
    return false;
  }
  forget_input(*idle);
  jobs_.erase(idle);
  return true;
}

void PlannerDesk::receive(const messages::PlanCancel& cancel) {
  Job* job = job_of(cancel.request_id);
  if (job == nullptr || job->is_over()) {
    return;
  }
  job->is_cancelled = true;
}

bool PlannerDesk::is_ready(const Job& job) const {
  return assembly_.map_of(job.question.map_hash) && !is_superseded(job) &&
         exchange_.is_complete(job.question.input.id);
}

bool PlannerDesk::is_superseded(const Job& job) const {
  const auto& index = assembly_.index();
  return index && !index->offers(job.question.map_hash);
}

std::string PlannerDesk::lack_of(const Job& job) const {
  if (!exchange_.is_complete(job.question.input.id)) {
    for (const bus::MissingChunks& missing : exchange_.missing()) {
      if (missing.blob_id == job.question.input.id) {
        return bus::to_text(missing);
      }
    }
    return job.question.input_name;
  }
  const auto& index = assembly_.index();
  if (is_superseded(job)) {
    return "map " + job.question.map_hash.hex() + "; the bus has " + map_text(*index);
  }
  if (assembly_.map_of(job.question.map_hash)) {
    return {};
  }
  if (index && !assembly_.refusal().empty()) {
    return assembly_.refusal();
  }
  return assembly_.missing();
}

void PlannerDesk::tick(Time now) {
  for (const Job& job : jobs_) {
    if (!job.is_over()) {
      assembly_.need(job.question.map_hash);
    }
  }
  assembly_.tick();
  answer_again();
  drop_old_answers();
  for (Job& job : jobs_) {
    if (job.is_over()) {
      continue;
    }
    if (job.is_cancelled) {
      cancel(job);
      publish_status(job, now);
    } else if (is_ready(job)) {
      work(job);
      return;  // other messages first
    } else {
      wait(job, now);
    }
  }
}

void PlannerDesk::wait(Job& job, Time now) {
  const bool is_overdue =
      !job.is_lack_named && seconds_between(job.asked, bus_.message_time()) > options_.patience_s;
  if (!is_overdue && now < job.next_status) {
    return;
  }
  const std::string lack = lack_of(job);
  job.status.text = "waiting for: " + lack;
  if (is_overdue) {
    job.is_lack_named = true;
    const std::string title = "request " + short_id(job.question.request_id);
    std::fprintf(stderr, "%s still waits for: %s\n", title.c_str(), lack.c_str());
    loop_.set_state(messages::ServiceState::kDegraded, title + " waits for: " + lack);
    if (is_superseded(job)) {
      job.status.state = PlanState::kRefused;
      job.status.text = "it asks for " + lack;
    }
  }
  publish_status(job, now);
}

void PlannerDesk::cancel(Job& job) {
  job.is_cancelled = false;
  job.status = {.request_id = job.question.request_id,
                .stage = stage_,
                .state = job.is_wanted_after_all ? PlanState::kWaiting : PlanState::kCancelled,
                .best_cost_m = {},
                .no_plan = {},
                .text = job.is_wanted_after_all ? "asked again" : "cancelled"};
  if (!job.is_wanted_after_all) {
    forget_input(job);
  }
  job.is_wanted_after_all = false;
}

void PlannerDesk::give_up(Job& job) {
  if (job.is_cancelled || bus::stop_requested()) {
    cancel(job);
    return;
  }
  job.status = {.request_id = job.question.request_id,
                .stage = stage_,
                .state = PlanState::kWaiting,
                .best_cost_m = {},
                .no_plan = {},
                .text = "waiting for: " + lack_of(job)};
  job.asked = bus_.message_time();
  std::fprintf(stderr, "request %s: the map has changed meanwhile; %s\n",
               short_id(job.question.request_id).c_str(), job.status.text.c_str());
}

void PlannerDesk::work(Job& job) {
  const std::string title = short_id(job.question.request_id);
  const std::int64_t patch_number = assembly_.patch_number();
  const std::string on_patch =
      patch_number > 0 ? " on patch " + std::to_string(patch_number) : std::string();
  loop_.set_state(messages::ServiceState::kWorking, "planning request " + title + on_patch);
  job.status.state = PlanState::kWorking;
  job.status.text.clear();
  publish_status(job, bus_.now());
  working_ = &job;
  const std::shared_ptr<const map::Map> map = assembly_.map_of(job.question.map_hash);
  const bool stays_on_bus = !bus_.url().starts_with("file:");
  WorkingObserver observer(*this, job, stays_on_bus);
  const auto refuse = [&](const std::string& why) {
    job.status.state = PlanState::kRefused;
    job.status.text = why;
    std::fprintf(stderr, "request %s refused: %s\n", title.c_str(), why.c_str());
  };
  try {
    auto result = job.question.plan(*map, *exchange_.content(job.question.input.id), observer);
    // A planner that is told to stop gives the best that it has so far; that is no answer.
    const bool is_superseded_now = is_superseded(job);
    if (job.is_cancelled || is_superseded_now || bus::stop_requested()) {
      if (const auto* answer = std::get_if<Answer>(&result)) {
        exchange_.withdraw(answer->blob_id);
      }
      give_up(job);
    } else if (auto* no_plan = std::get_if<flight::NoPlan>(&result)) {
      job.status.state = PlanState::kNoPlan;
      job.status.text = no_plan->explanation;
      job.status.no_plan = std::move(*no_plan);
    } else {
      job.answer = std::move(std::get<Answer>(result));
      job.status.state = PlanState::kDone;
      job.status.text.clear();
    }
  } catch (const Interrupted&) {
    give_up(job);
  } catch (const UserError& error) {
    refuse(error.hint().empty() ? error.what() : error.what() + ("; " + error.hint()));
  } catch (const std::exception& error) {
    refuse(error.what());
  }
  working_ = nullptr;
  held_up_.clear();
  if (job.status.state == PlanState::kDone) {
    job.answer.publish();
  } else if (job.status.state == PlanState::kRefused) {
    forget_input(job);
  }
  publish_status(job, bus_.now());
  loop_.set_state(messages::ServiceState::kReady, "last request " + title + on_patch);
}

void PlannerDesk::report(const global_planning::RouteProgress& progress) {
  if (working_ == nullptr) {
    return;
  }
  working_->status.work_units = progress.work_units;
  working_->status.work_budget = progress.work_budget;
  working_->status.best_cost_m = std::isfinite(progress.best_cost_m)
                                     ? std::optional<double>(progress.best_cost_m)
                                     : std::nullopt;
  working_->status.lower_bound_m = progress.lower_bound_m;
}

void PlannerDesk::hold_up(const std::string& lack) {
  if (working_ == nullptr) {
    return;
  }
  held_up_ = lack;
  working_->status.text = lack;
  const std::string title = "request " + short_id(working_->question.request_id);
  if (lack.empty()) {
    loop_.set_state(messages::ServiceState::kWorking, "planning " + title);
  } else {
    std::fprintf(stderr, "%s is %s\n", title.c_str(), lack.c_str());
    loop_.set_state(messages::ServiceState::kDegraded, title + " is " + lack);
  }
  publish_status(*working_, bus_.now());
}

void PlannerDesk::answer_again() {
  for (Job& job : jobs_) {
    if (!job.is_asked_again) {
      continue;
    }
    job.is_asked_again = false;
    if (job.status.state == PlanState::kDone) {
      job.answer.publish();
    }
    publish_status(job, bus_.now());
  }
}

void PlannerDesk::publish_status_if_due(Job& job, Time now) {
  if (now >= job.next_status) {
    publish_status(job, now);
  }
}

void PlannerDesk::publish_status(Job& job, Time now) {
  job.next_status = now + options_.status_period_s;
  bus_.publish(messages::kPlanStatusChannel, job.status, now);
}

// Requests may share their input: the same config comes with each of a user's requests.
void PlannerDesk::forget_input(const Job& job) {
  for (const Job& other : jobs_) {
    if (&other != &job && other.question.input.id == job.question.input.id) {
      return;
    }
  }
  exchange_.forget(job.question.input.id);
}

void PlannerDesk::drop_old_answers() {
  auto kept =
      std::count_if(jobs_.begin(), jobs_.end(), [](const Job& job) { return job.is_over(); });
  for (auto job = jobs_.begin(); job != jobs_.end() && kept > options_.kept_answers;) {
    if (!job->is_over()) {
      ++job;
      continue;
    }
    if (job->status.state == PlanState::kDone) {
      exchange_.withdraw(job->answer.blob_id);
    }
    forget_input(*job);
    job = jobs_.erase(job);
    --kept;
  }
}

std::string PlannerDesk::unanswered() const {
  std::string lines;
  for (const Job& job : jobs_) {
    if (job.status.state == PlanState::kWaiting) {
      lines += "request " + job.question.request_id.hex() + " lacks: " + lack_of(job) + "\n";
    }
  }
  return lines;
}

}  // namespace hedgehop::services
