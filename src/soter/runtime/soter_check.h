/* soter_check.h: what must be so in the C that ships, checked as it runs.
 *
 * Purpose: SOTER_CHECK(condition). Where it does not hold, this program, its build or its memory
 * has a defect: no value from outside can do it, those are refused with a code. What happens then
 * is the driver's: it defines soter_check_failed, once in a program; docs/deploy.md, "Checks", says
 * what that may be on a board. Non-goals: assert: it would link printf; telling of faults of steps.
 *
 * -DSOTER_UNCHECKED leaves all checks out; NDEBUG does not: what flies is what was tested.
 * -DSOTER_UNNAMED_CHECKS leaves out which one failed, for a driver that tells nobody.
 */
#ifndef SOTER_CHECK_H
#define SOTER_CHECK_H

#ifdef __cplusplus
extern "C" {
#endif

/* Yours. It may not return: nothing behind a check is meant to run where it fails. Actuators have
 * to come to their fail-safe law without anything of the program: its state may be wrong. */
#if defined(__GNUC__)
__attribute__((cold, noreturn))
#endif
void soter_check_failed(const char* file, int line, const char* what);

#ifdef __cplusplus
}
#endif

#if defined(SOTER_UNCHECKED)
#define SOTER_CHECK(condition) ((void)0)
#elif defined(SOTER_UNNAMED_CHECKS)
#define SOTER_CHECK(condition) ((condition) ? (void)0 : soter_check_failed("", 0, ""))
#else
#define SOTER_CHECK(condition) \
  ((condition) ? (void)0 : soter_check_failed(__FILE__, __LINE__, #condition))
#endif

#endif
