"""What continuous integration reads: SARIF, JUnit's XML, commands of GitHub's workflows."""
