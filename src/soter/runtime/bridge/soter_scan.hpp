/* soter_scan.hpp: what is nearest in a sensor_msgs/LaserScan.
 *
 * Purpose: the distance and the bearing that a mapping asks for (`nearest = "distance"`), from rays
 * of which, after REP 117, +inf saw nothing, -inf saw something too near to be measured, and NaN is
 * no measurement; many drivers write 0 for that, too. A scan that leaves out a sector is refused: a
 * robot that turns has no side that it need not see. And when it was measured.
 * Non-goals: what lies between two rays, which is part of the error that the program declares
 * (docs/ground-robot.md). C++11.
 */
#ifndef SOTER_SCAN_HPP
#define SOTER_SCAN_HPP

#include <cmath>
#include <cstddef>
#include <cstdint>

namespace soter {

/* False where a sector is missing: the rays do not go round once, or more than `unseen` of them in
 * a row measured nothing (the first one follows the last). Else *distance is the least range,
 * `most` at most, and *bearing that of its ray, in [-pi, pi], to the left. */
template <class Scan>
inline bool nearest_in(const Scan& scan, double most, std::size_t unseen, double* distance,
                       double* bearing) {
  const double PI = 3.14159265358979323846;
  const std::size_t n = scan.ranges.size();
  const double step = static_cast<double>(scan.angle_increment);
  const double first = static_cast<double>(scan.angle_min);
  if (n == 0U || !std::isfinite(step) || !std::isfinite(first) ||
      !(std::fabs(static_cast<double>(n) * std::fabs(step) - 2.0 * PI) <= 1.5 * std::fabs(step))) {
    return false;
  }
  std::size_t row = 0U; /* rays without a measurement up to here, once round and once more */
  std::size_t at = 0U;
  *distance = most;
  for (std::size_t k = 0U; k < 2U * n; k++) {
    const std::size_t i = k % n;
    const double range = static_cast<double>(scan.ranges[i]);
    const bool too_near = std::isinf(range) && range < 0.0;
    if (!too_near && !(range > 0.0)) { /* NaN, 0, negative */
      row++;
      if (row > unseen) {
        return false;
      }
      continue;
    }
    row = 0U;
    const double seen = too_near ? 0.0 : range;
    if (k < n && seen < *distance) {
      *distance = seen;
      at = i;
    }
  }
  *bearing = std::remainder(first + static_cast<double>(at) * step, 2.0 * PI);
  return std::isfinite(*bearing);
}

template <class Scan>
inline bool nearest_distance(const Scan& scan, double most, std::size_t unseen, double* distance) {
  double bearing = 0.0;
  return nearest_in(scan, most, unseen, distance, &bearing);
}

template <class Scan>
inline bool nearest_bearing(const Scan& scan, double most, std::size_t unseen, double* bearing) {
  double distance = 0.0;
  return nearest_in(scan, most, unseen, &distance, bearing);
}

/* When the last ray was measured, ns: `stamp_ns`, the stamp of a scan, is that of its first ray. A
 * scan that does not say how long its rays take, or says more than a second, keeps the stamp, which
 * is the older one. */
template <class Scan>
inline int64_t last_ray_ns(const Scan& scan, int64_t stamp_ns) {
  const double rays = static_cast<double>(scan.ranges.size());
  const double sweep_s = (rays - 1.0) * static_cast<double>(scan.time_increment);
  if (!(sweep_s > 0.0 && sweep_s <= 1.0) || stamp_ns <= 0) {
    return stamp_ns;
  }
  return stamp_ns + static_cast<int64_t>(sweep_s * 1e9);
}

}  // namespace soter

#endif
