// SPDX-License-Identifier: GPL-3.0-or-later
// What a stage returns: an artefact with notes, or a refusal with the number that decided. Bugs throw.
#pragma once

#include <stdexcept>
#include <string>
#include <string_view>
#include <tl/expected.hpp>
#include <utility>
#include <vector>

namespace asbuilt {

/// "This job may not be cut, and here is the number that says so." A normal value, not a crash.
struct Refusal {
  std::string code;     // stable, dotted, tested: "locate.ambiguous"
  std::string where;    // "part.yaml:12: features[0].edges", "edge #417 at 31.2 mm"
  std::string message;  // one sentence for the person on the floor: what, the number, the limit, what to do next
  double measured = 0, limit = 0;
  std::string unit;
  std::string stage;    // input | fuse | locate | fit | burr | path | motion | post | verify; empty: the stage that returned it

  template <class S, class A>
  static void visit(S& s, A&& a) {
    a("code", s.code), a("where", s.where), a("message", s.message), a("measured", s.measured), a("limit", s.limit);
    a("unit", s.unit), a("stage", s.stage);
  }
};

/// Something worth knowing that does not stop the job.
struct Note {
  enum class Level { note, warning };
  Level level = Level::note;
  std::string code, text, where;

  template <class S, class A>
  static void visit(S& s, A&& a) {
    a("level", s.level), a("code", s.code), a("text", s.text), a("where", s.where);
  }
};

/// All refusals at once where a stage can find more than one; never empty.
using Refusals = std::vector<Refusal>;

template <class T>
using Result = tl::expected<T, Refusals>;

template <class T>
struct Done {
  T artefact;
  std::vector<Note> notes;
};

inline tl::unexpected<Refusals> refuse(Refusal r) { return tl::unexpected<Refusals>(Refusals{std::move(r)}); }
inline tl::unexpected<Refusals> refuse_all(Refusals r) { return tl::unexpected<Refusals>(std::move(r)); }

/// A broken promise of our own code. Only the runner catches it; the item is marked failed.
struct Bug : std::logic_error {
  using std::logic_error::logic_error;
};
inline void must(bool condition, std::string_view what) {
  if (!condition) throw Bug(std::string(what));
}

}  // namespace asbuilt
