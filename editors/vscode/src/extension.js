// The extension: starts `soter lsp`, and runs what a lens says in a terminal.
// Non-goals: anything about the language; the server knows it (src/soter/lsp).
"use strict";

const vscode = require("vscode");
const { LanguageClient, TransportKind } = require("vscode-languageclient/node");

/** @type {LanguageClient | undefined} */
let client;

function command() {
  return vscode.workspace.getConfiguration("soter").get("command", "soter");
}

function made() {
  const server = { command: command(), args: ["lsp"], transport: TransportKind.stdio };
  return new LanguageClient(
    "soter",
    "Soter",
    { run: server, debug: server },
    {
      documentSelector: [{ language: "soter" }],
      synchronize: {
        fileEvents: vscode.workspace.createFileSystemWatcher("**/*.{soter,json,csv,npy}"),
      },
    },
  );
}

async function start() {
  client = made();
  try {
    await client.start();
  } catch (error) {
    const fix = "Install it with: pip install 'soter-rta[editor]', or set soter.command.";
    vscode.window.showErrorMessage(`\`${command()} lsp\` does not start (${error}). ${fix}`);
  }
}

async function restart() {
  if (client !== undefined) {
    await client.stop().catch(() => undefined);
  }
  await start();
}

/** What a lens runs: `{command: ["soter", "verify", ...], cwd}`, where a person sees it. */
async function inTerminal({ command: [, ...words], cwd }) {
  await vscode.workspace.saveAll(false);
  const title = words.slice(0, 2).join(" ");
  const run = new vscode.ProcessExecution(command(), words, { cwd });
  const task = new vscode.Task(
    { type: "soter", words },
    vscode.TaskScope.Workspace,
    title,
    "soter",
    run,
    [],
  );
  task.presentationOptions = { reveal: vscode.TaskRevealKind.Always, clear: true };
  return vscode.tasks.executeTask(task);
}

/** A proof may have ended: lenses are asked for again. */
function refreshLenses() {
  const feature = client?.getFeature("textDocument/codeLens");
  for (const document of vscode.workspace.textDocuments) {
    if (document.languageId === "soter") {
      feature?.getProvider(document)?.onDidChangeCodeLensEmitter.fire();
    }
  }
}

async function activate(context) {
  context.subscriptions.push(
    vscode.commands.registerCommand("soter.restart", restart),
    vscode.commands.registerCommand("soter.terminal", inTerminal),
    vscode.tasks.onDidEndTaskProcess((event) => {
      if (event.execution.task.source === "soter") {
        refreshLenses();
      }
    }),
    vscode.workspace.onDidChangeConfiguration((event) => {
      if (event.affectsConfiguration("soter.command")) {
        restart();
      }
    }),
  );
  await start();
}

function deactivate() {
  return client?.stop();
}

module.exports = { activate, deactivate };
