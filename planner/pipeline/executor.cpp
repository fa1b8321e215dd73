// SPDX-License-Identifier: GPL-3.0-or-later
#include "planner/pipeline/executor.hpp"

#include <fcntl.h>
#include <fmt/format.h>
#include <poll.h>
#include <sys/prctl.h>
#include <sys/wait.h>
#include <unistd.h>

#include <cerrno>
#include <chrono>
#include <csignal>
#include <cstring>

#include "planner/base/archive.hpp"
#include "planner/pipeline/store.hpp"

namespace asbuilt {

namespace fs = std::filesystem;
using Clock = std::chrono::steady_clock;

std::string blame_of(const std::string& stage) {
  if (stage == "program") return "motion";
  if (stage == "report" || stage == "release") return "post";
  return stage.empty() ? "input" : stage;
}

std::string order_json(const ItemTask& task, const BatchOptions& options, int events_fd) {
  Json order;
  order["batch"] = task.batch_file.string();
  order["item"] = task.item;
  order["out"] = fs::absolute(options.item.out).string();
  order["allow_outside"] = options.item.inputs.allow_outside;
  order["today"] = options.item.inputs.today;
  order["code_tag"] = options.item.code_tag;
  order["languages"] = Json::array();
  for (const Language l : options.item.languages) order["languages"].push_back(std::string(name_of(l)));
  order["events"] = events_fd;
  return order.dump();
}

namespace {

std::string event_line(const StageEvent& e) {
  Json j;
  j["stage"] = e.stage;
  j["what"] = static_cast<int>(e.what);
  j["time_s"] = e.time_s;
  j["memory"] = e.peak_memory_mib;
  j["key"] = e.key;
  j["parts"] = e.parts;
  return j.dump() + "\n";
}

StageEvent event_from_line(const std::string& line, const std::string& item) {
  const Json j = Json::parse(line);
  StageEvent e;
  e.item = item;
  e.stage = j.at("stage");
  e.what = static_cast<StageEvent::What>(j.at("what").get<int>());
  e.time_s = j.at("time_s");
  e.peak_memory_mib = j.at("memory");
  e.key = j.at("key");
  e.parts = j.at("parts").get<std::map<std::string, std::string>>();
  return e;
}

struct Child {
  std::size_t index = 0;
  pid_t pid = -1;
  int events = -1;
  std::string unread;
  std::string stage;  // the last one begun
  Clock::time_point start;
  bool is_over_time = false;
  ItemEnd end;
};

volatile std::sig_atomic_t interrupted = 0;
void on_interrupt(int signal) { interrupted = signal; }

Child start_child(std::size_t index, const ItemTask& task, const BatchOptions& options) {
  int ends[2];
  if (::pipe2(ends, O_CLOEXEC) != 0) throw std::runtime_error(fmt::format("no pipe to a worker: {}", std::strerror(errno)));
  constexpr int kEventsFd = 3;
  std::vector<std::string> words = options.worker;
  must(!words.empty(), "a batch needs the command of its worker");
  words.push_back(order_json(task, options, kEventsFd));
  std::vector<char*> argv;
  for (std::string& w : words) argv.push_back(w.data());
  argv.push_back(nullptr);
  const pid_t parent = ::getpid();
  const pid_t pid = ::fork();
  if (pid < 0) throw std::runtime_error(fmt::format("no process for a worker: {}", std::strerror(errno)));
  if (pid == 0) {  // only calls that are safe between fork and exec
    ::prctl(PR_SET_PDEATHSIG, SIGKILL);
    if (::getppid() != parent) ::_exit(1);
    ::setpgid(0, 0);
    if (ends[1] == kEventsFd) {
      ::fcntl(kEventsFd, F_SETFD, 0);
    } else {
      ::dup2(ends[1], kEventsFd);
    }
    ::dup2(2, 1);  // standard output belongs to the command
    ::execv(argv[0], argv.data());
    ::_exit(126);
  }
  ::close(ends[1]);
  ::fcntl(ends[0], F_SETFL, O_NONBLOCK);
  Child child;
  child.index = index;
  child.pid = pid;
  child.events = ends[0];
  child.start = Clock::now();
  return child;
}

void read_events(Child& child, const std::string& item, const BatchOptions& options) {
  char buffer[4096];
  for (ssize_t n; (n = ::read(child.events, buffer, sizeof buffer)) > 0;) child.unread.append(buffer, static_cast<std::size_t>(n));
  for (std::size_t end; (end = child.unread.find('\n')) != std::string::npos; child.unread.erase(0, end + 1)) {
    const StageEvent event = event_from_line(child.unread.substr(0, end), item);
    child.stage = event.stage;
    if (event.what != StageEvent::What::begun) {
      child.end.timing_s[event.stage] += event.time_s;
      double& peak = child.end.peak_memory_mib[event.stage];
      peak = std::max(peak, event.peak_memory_mib);
    }
    if (options.watch) options.watch(event);
  }
}

void explain_end(Child& child, int status, const fs::path& result, double timeout_s) {
  ItemEnd& end = child.end;
  const std::string stage = child.stage.empty() ? "start" : child.stage;
  end.blame = blame_of(child.stage);
  if (child.is_over_time) {
    end.code = "failed.timeout";
    end.message = fmt::format("stopped in stage {} after the time limit of {:g} s; raise --timeout or look at the item alone with --only", stage, timeout_s);
  } else if (WIFSIGNALED(status)) {
    const int signal = WTERMSIG(status);
    end.code = "failed.signal";
    end.message = fmt::format("the item's process was ended in stage {} by signal {} ({}){}; the other items went on", stage, signal,
                              ::strsignal(signal), signal == SIGKILL ? ", often the system running out of memory: run fewer items at once (-j)" : "");
  } else if (const int code = WEXITSTATUS(status); (code == 0 || code == 3 || code == 4) && fs::exists(result)) {
    end.code.clear();
  } else {
    end.code = "failed.exit";
    end.message = fmt::format("the item's process ended in stage {} with status {} and no result", stage, code);
  }
}

}  // namespace

void run_items_here(const std::vector<ItemTask>& tasks, const BatchOptions& options, const ItemFinished& finished) {
  interrupted = 0;
  struct sigaction mine {}, old_int{}, old_term{};
  mine.sa_handler = on_interrupt;
  ::sigaction(SIGINT, &mine, &old_int);
  ::sigaction(SIGTERM, &mine, &old_term);
  std::vector<Child> children;
  std::size_t next = 0;
  while (!interrupted && (next < tasks.size() || !children.empty())) {
    while (next < tasks.size() && children.size() < static_cast<std::size_t>(std::max(1, options.jobs_count))) {
      children.push_back(start_child(next, tasks[next], options));
      ++next;
    }
    std::vector<pollfd> waits;
    for (const Child& c : children) waits.push_back({c.events, POLLIN, 0});
    ::poll(waits.data(), waits.size(), 200);
    for (std::size_t k = 0; k < children.size();) {
      Child& c = children[k];
      read_events(c, tasks[c.index].item, options);
      int status = 0;
      if (::waitpid(c.pid, &status, WNOHANG) != c.pid) {
        const double age_s = std::chrono::duration<double>(Clock::now() - c.start).count();
        if (options.timeout_s > 0 && age_s > options.timeout_s && !c.is_over_time) {
          c.is_over_time = true;
          ::kill(-c.pid, SIGKILL);
        }
        ++k;
        continue;
      }
      ::kill(-c.pid, SIGKILL);  // whatever it may have left behind
      read_events(c, tasks[c.index].item, options);
      ::close(c.events);
      explain_end(c, status, options.item.out / tasks[c.index].item / "result.json", options.timeout_s);
      const Child ended = std::move(c);
      children.erase(children.begin() + static_cast<std::ptrdiff_t>(k));
      finished(ended.index, ended.end);
    }
  }
  for (const Child& c : children) {
    ::kill(-c.pid, SIGKILL);
    ::waitpid(c.pid, nullptr, 0);
    ::close(c.events);
  }
  ::sigaction(SIGINT, &old_int, nullptr);
  ::sigaction(SIGTERM, &old_term, nullptr);
  if (interrupted) ::raise(interrupted);
}

int run_order(const std::string& text) {
  ItemOptions options;
  std::string item;
  int events = -1;
  const Json order = Json::parse(text);
  item = order.at("item");
  options.out = order.at("out").get<std::string>();
  options.inputs.allow_outside = order.at("allow_outside");
  options.inputs.today = order.at("today");
  options.code_tag = order.at("code_tag");
  for (const Json& l : order.at("languages"))
    for (const Language language : kLanguages)
      if (name_of(language) == l.get<std::string>()) options.languages.push_back(language);
  events = order.at("events");
  const auto tell = [&](const StageEvent& event) {
    if (events < 0) return;
    const std::string line = event_line(event);
    if (::write(events, line.data(), line.size()) < 0) events = -1;  // nobody listens; the work goes on
  };
  auto batch = load_batch(order.at("batch").get<std::string>(), options.inputs);
  ItemRecord record;
  if (batch) {
    record = run_item(batch->artefact, item, options, tell);
  } else {
    record.item_id = item;
    record.status = ItemStatus::refused;
    record.reasons = batch.error();
  }
  tell({.item = item, .stage = "release"});
  write_item(options.out, record);
  return record.status == ItemStatus::emitted ? 0 : record.status == ItemStatus::refused ? 3 : 4;
}

}  // namespace asbuilt
