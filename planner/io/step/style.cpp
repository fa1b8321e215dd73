// SPDX-License-Identifier: GPL-3.0-or-later
#include "planner/io/step/style.hpp"

#include <algorithm>
#include <array>
#include <cmath>

namespace asbuilt::step {

using namespace p21;

namespace {

std::string hex(double r, double g, double b) {
  std::string s = "#";
  for (double v : {r, g, b}) {
    const int k = static_cast<int>(std::lround(255 * std::clamp(v, 0.0, 1.0)));
    for (int d : {k / 16, k % 16}) s += "0123456789abcdef"[d];
  }
  return s;
}

class StyleReader {
 public:
  explicit StyleReader(const Binder& b) : b_(b), f_(b.file()) {}

  Styles run() {
    std::vector<const Instance*> overriding;
    for (const Instance& i : f_.instances) {
      if (i.record_count == 0) continue;
      const std::uint32_t k = b_.key(i);
      if (k == K_STYLED_ITEM) item(i, false);
      if (k == K_OVER_RIDING_STYLED_ITEM) overriding.push_back(&i);
      if (k == K_PRESENTATION_LAYER_ASSIGNMENT) layer(i);
    }
    for (const Instance* i : overriding) item(*i, true);
    return std::move(out_);
  }

 private:
  void item(const Instance& i, bool replaces) try {
    const Args a = b_.args(i);
    const std::int64_t on = b_.reference(i, a.at(2));
    for (std::int64_t s : b_.references(i, a.at(1))) {
      const std::string c = color_under(s);
      if (c.empty()) continue;
      if (replaces)
        out_.color[on] = c;
      else
        out_.color.emplace(on, c);
      return;
    }
  } catch (const StepFault&) {
  }
  void layer(const Instance& i) try {
    const Args a = b_.args(i);
    std::string name = b_.text(a.at(0));
    if (const std::string more = b_.text(a.at(1)); !more.empty() && more != " " && more != name) name += " " + more;
    for (std::int64_t on : b_.references(i, a.at(2))) out_.layer.emplace(on, name);
  } catch (const StepFault&) {
  }

  /// The first colour reached over references, breadth first, not through the styles of curves, points and texts.
  std::string color_under(std::int64_t style) {
    const auto known = known_.find(style);
    if (known != known_.end()) return known->second;
    std::vector<std::int64_t> queue{style};
    std::string found;
    for (std::size_t at = 0; at < queue.size() && queue.size() < 200 && found.empty(); ++at) {
      const Instance* i = f_.find(queue[at]);
      if (!i || i->record_count == 0) continue;
      const std::uint32_t k = b_.key(*i);
      if (k == K_CURVE_STYLE || k == K_POINT_STYLE || k == K_TEXT_STYLE) continue;
      found = color(*i, k);
      for (std::uint32_t r = 0; r < i->record_count && found.empty(); ++r) {
        const Record& rec = f_.records[i->record + r];
        const Value* v = f_.values.data() + rec.first;
        for (std::uint32_t p = 0; p < rec.count; ++p, v = next(v)) {
          const Value* end = next(v);
          for (const Value* q = v; q < end && queue.size() < 200; ++q)
            if (q->kind == Kind::reference && std::find(queue.begin(), queue.end(), q->integer) == queue.end()) queue.push_back(q->integer);
        }
      }
    }
    known_.emplace(style, found);
    return found;
  }
  std::string color(const Instance& i, std::uint32_t k) const try {
    if (k == K_COLOUR_RGB) {
      const Args a = b_.args(i);
      return hex(b_.real(i, a.at(1)), b_.real(i, a.at(2)), b_.real(i, a.at(3)));
    }
    if (k == K_DRAUGHTING_PRE_DEFINED_COLOUR || k == K_PRE_DEFINED_COLOUR) {
      const std::string name = b_.text(b_.args(i).at(0));
      constexpr std::array<std::pair<const char*, const char*>, 8> all{{{"red", "#ff0000"},
                                                                        {"green", "#00ff00"},
                                                                        {"blue", "#0000ff"},
                                                                        {"yellow", "#ffff00"},
                                                                        {"magenta", "#ff00ff"},
                                                                        {"cyan", "#00ffff"},
                                                                        {"black", "#000000"},
                                                                        {"white", "#ffffff"}}};
      for (const auto& [n, c] : all)
        if (name == n) return c;
    }
    return "";
  } catch (const StepFault&) {
    return "";
  }

  const Binder& b_;
  const File& f_;
  Styles out_;
  std::unordered_map<std::int64_t, std::string> known_;
};

}  // namespace

Styles read_styles(const Binder& b) { return StyleReader(b).run(); }

}  // namespace asbuilt::step
