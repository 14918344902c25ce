/* soter_sources.hpp: which of several sources of one topic is read.
 *
 * Purpose: the rule, by stamps: it is a sample's turn where it was measured more than `after`
 * later than the newest sample of the sources before it whose turn it was; in its turn it is taken
 * where it is newer than all that was taken. So the topic never goes back in measuring time, the
 * first source is read again as soon as it speaks again, and a log that has the same samples in the
 * same order gives the same ones (docs/mapping.md, "Several sources"). Each source is judged by
 * its own rules before.
 * Non-goals: what the sources promise, which `soter build` compared. C++11.
 */
#ifndef SOTER_SOURCES_HPP
#define SOTER_SOURCES_HPP

#include "soter_check.h"

#include <cstddef>
#include <cstdint>
#include <functional>
#include <mutex>
#include <vector>

namespace soter {

class Sources {
 public:
  enum Verdict { TAKEN, WAITS, OLDER };

  /* What happened since the begin. `gap_ns`: the longest time between the stamps of two samples
   * that were taken one after the other. */
  struct Counts {
    bool read = false; /* the last sample that was taken is of this source */
    uint64_t takeovers = 0, waited = 0, older = 0;
    int64_t gap_ns = 0;
  };

  /* Of each source, the preferred first, by how much it has to be younger than those before it. */
  explicit Sources(const std::vector<int64_t>& after_ns)
      : after_(after_ns), newest_(after_ns.size(), 0), of_(after_ns.size()) {}

  /* What becomes of a sample that was measured at `stamp_ns`, above 0; `write` writes it where it
   * is taken. Sources may speak on threads of their own: there is one writer at a time. */
  Verdict take(size_t rank, int64_t stamp_ns, const std::function<void()>& write) {
    SOTER_CHECK(rank < of_.size() && stamp_ns > 0);
    const std::lock_guard<std::mutex> held(lock_);
    for (size_t k = 0; k < rank; k++) {
      if (newest_[k] > 0 && stamp_ns <= newest_[k] + after_[rank]) {
        of_[rank].waited++;
        return WAITS;
      }
    }
    newest_[rank] = stamp_ns > newest_[rank] ? stamp_ns : newest_[rank];
    if (stamp_ns <= taken_) {
      of_[rank].older++;
      return OLDER;
    }
    note(rank, stamp_ns);
    write();
    return TAKEN;
  }

  /* A time that began anew: nothing was taken yet. */
  void forget() {
    const std::lock_guard<std::mutex> held(lock_);
    newest_.assign(newest_.size(), 0);
    taken_ = 0;
  }

  Counts counts(size_t rank) {
    SOTER_CHECK(rank < of_.size());
    const std::lock_guard<std::mutex> held(lock_);
    Counts to = of_[rank];
    to.read = taken_ > 0 && read_ == rank;
    to.gap_ns = gap_ns_;
    return to;
  }

 private:
  void note(size_t rank, int64_t stamp_ns) {
    if (taken_ > 0) {
      of_[rank].takeovers += rank != read_ ? 1U : 0U;
      gap_ns_ = stamp_ns - taken_ > gap_ns_ ? stamp_ns - taken_ : gap_ns_;
    }
    taken_ = stamp_ns;
    read_ = rank;
  }

  std::mutex lock_;
  const std::vector<int64_t> after_;
  std::vector<int64_t> newest_; /* by source the stamp of the newest one in its turn; 0: none */
  std::vector<Counts> of_;
  int64_t taken_ = 0, gap_ns_ = 0;
  size_t read_ = 0;
};

/* Traits of a topic that has one source. Of one of several, generated: `Shared`, a type that all of
 * them name, `sources`, the object that they share, `rank` among them, and whether the topic takes
 * a value, as a source of nothing but NaN is silent. */
struct OneSource {
  typedef void Shared;
  static Sources* sources() { return nullptr; }
  static size_t rank() { return 0; }
  template <class Value>
  static bool fits(const Value& /*value*/) {
    return true;
  }
};

} /* namespace soter */

#endif
