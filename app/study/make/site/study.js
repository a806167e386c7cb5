// The page for participants. It needs no server: everything it shows comes from study-data.js and
// media/, and what it is told stays in this browser until the participant sends or saves it.
"use strict";

(function () {
  const study = window.STUDY;
  const words = study.words;
  const main = document.getElementById("main");
  const query = new URLSearchParams(location.search);
  const isPreview = query.has("preview"); // by the researcher, who is not a participant
  const postTo = isPreview ? null : study.postTo;
  const listParam = query.get("p");
  const token = /^\d{1,6}-[0-9a-f]{32}$/.test(query.get("t") || "") ? query.get("t") : null; // a signed link

  const PANEL_VALUE = /^[A-Za-z0-9_.~-]{1,64}$/; // no placeholder that a panel left open, no text
  const panel = Object.fromEntries( // ids that the plan names, and no others
    (study.panelIds || [])
      .map((name) => [name, query.get(name) || ""])
      .filter(([, value]) => PANEL_VALUE.test(value))
  );
  const panelOwn = panel[(study.panelIds || [])[0]]; // the participant's own id there

  function fill(text, values) {
    return text.replace(/\{(\w+)\}/g, (whole, name) => (name in values ? values[name] : whole));
  }

  /** An element with properties, and children that are elements or texts; null is none. */
  function make(tag, properties, ...children) {
    const element = document.createElement(tag);
    for (const [name, value] of Object.entries(properties || {})) {
      if (name.includes("-") || name === "role") element.setAttribute(name, value);
      else element[name] = value;
    }
    element.append(...children.filter((child) => child !== null));
    return element;
  }

  const button = (text, onclick, properties) => make("button", { type: "button", onclick, ...properties }, text);
  const actions = (...buttons) => make("div", { className: "actions" }, ...buttons);
  const problem = (text) => make("p", { className: "problem", role: "alert" }, text);
  const randomBelow = (limit) => crypto.getRandomValues(new Uint32Array(1))[0] % limit;

  function randomHex(bytes) {
    const values = crypto.getRandomValues(new Uint8Array(bytes));
    return Array.from(values, (value) => value.toString(16).padStart(2, "0")).join("");
  }

  // ---------------------------------------------------------------- what is kept in the browser
  // Each answered page lies under a name of its own, so that several tabs lose nothing of each other.

  const whoKey = `study/${study.study}/who/${listParam === null ? "" : listParam}${token ? `/${token}` : ""}${panelOwn ? `/${panelOwn}` : ""}`;
  let who = ""; // the participant
  let list = 0;
  let about = null; // how far they are, but for the answers
  let pages = {}; // answers by trial
  let draft = null; // of the page that is shown
  let shownSince = 0; // when it appeared
  let canStore = true; // whether the browser keeps anything

  function storage(access) {
    if (isPreview) return null;
    try {
      return access(localStorage);
    } catch {
      canStore = false;
      return null;
    }
  }

  const keyOf = (name) => `study/${study.study}/${who}/${name}`;
  const keep = (name, value) => storage((all) => all.setItem(keyOf(name), JSON.stringify(value)));

  /** Return the stored value of a name, or null if there is none or it cannot be read. */
  function readStored(name) {
    try {
      return JSON.parse(storage((all) => all.getItem(keyOf(name))));
    } catch {
      return null;
    }
  }

  /** The participant of this address, or a new one. */
  function load(isNew = false) {
    const stored = isNew ? null : storage((all) => all.getItem(whoKey));
    const [, participant, number] = /^([0-9a-f]{16}) (\d{1,6})$/.exec(stored || "") || [];
    const isOld = participant !== undefined && Number(number) < study.lists.length;
    who = isOld ? participant : randomHex(8);
    list = isOld ? Number(number) : listParam === null ? randomBelow(study.lists.length) : Number(listParam);
    storage((all) => all.setItem(whoKey, `${who} ${list}`));
    pages = {};
    for (const [id] of study.lists[list]) {
      const saved = readStored(`page/${id}`);
      if (saved) pages[id] = saved;
    }
    about = readStored("about") || {
      started: new Date().toISOString(), finished: null, headphones: "skipped",
      screen: Object.keys(pages).length ? "trial" : "consent", arrived: 0, saved: null,
    };
    keep("about", about);
  }

  /** The first page that is not answered, or how many there are. */
  function place() {
    const open = study.lists[list].findIndex(([id]) => !pages[id]);
    return open < 0 ? study.lists[list].length : open;
  }

  const answers = () => study.lists[list].flatMap(([id]) => pages[id] || []);
  const isSent = () => Boolean(postTo) && about.finished !== null && about.arrived === answers().length;

  function openDraft(trial) {
    draft = readStored("draft");
    if (draft?.trial !== trial) draft = { trial, watched: {}, values: {}, reasons: [], failed: {}, ms: 0 };
    shownSince = performance.now() - draft.ms;
  }

  function keepDraft() {
    draft.ms = Math.round(performance.now() - shownSince);
    keep("draft", draft);
  }

  window.addEventListener("storage", (event) => {
    if (!about || !(event.key || "").startsWith(keyOf("page/"))) return;
    const before = place();
    load();
    if (place() !== before) render(); // another tab goes ahead
  });

  /** The file that the researcher gets. */
  function answersFile() {
    return {
      format: 1,
      study: study.study,
      participant: who,
      list,
      started: about.started,
      finished: about.finished,
      device: { width: window.innerWidth, height: window.innerHeight, touch: navigator.maxTouchPoints > 0 },
      headphones: about.headphones,
      ...(token ? { link: token } : {}),
      ...(Object.keys(panel).length ? { panel } : {}),
      answers: answers(),
    };
  }

  // ---------------------------------------------------------------- screens

  let onKey = null;

  function show(heading, ...children) {
    document.querySelectorAll("video").forEach((video) => video.pause());
    main.replaceChildren(...children.filter((child) => child !== null));
    window.scrollTo(0, 0);
    if (heading) {
      heading.tabIndex = -1; // read out by screen readers, and the place from where Tab goes on
      heading.focus({ preventScroll: true });
    }
  }

  function sheet(heading, ...children) {
    const title = make("h1", {}, heading);
    show(title, make("section", { className: "sheet" }, title, ...children));
  }

  const paragraph = (text) => (text ? make("p", {}, text) : null);

  function render() {
    onKey = null;
    const total = study.lists[list].length;
    const number = place();
    const screen = about.screen === "trial" && number === total ? "finish" : about.screen;
    document.getElementById("place").textContent = screen === "trial"
      ? fill(words.progress.trial, { number: number + 1, total })
      : screen === "practice" ? words.practice.place : "";
    document.getElementById("progress").value = number / total;
    ({ consent: showConsent, sound: showSoundCheck, practice: showPractice, trial: showTrial, finish: showFinish })[screen]();
    if (!canStore) main.append(problem(words.problems.storage));
  }

  function goTo(screen) {
    about.screen = screen;
    keep("about", about);
    render();
  }

  function showConsent() {
    const start = button(words.buttons.start, () => goTo(study.sound ? "sound" : "practice"), {
      className: "main", disabled: true,
    });
    const box = make("input", { type: "checkbox", id: "agree", onchange: () => (start.disabled = !box.checked) });
    const fields = ["researchers", "contact", "ethics"].filter((name) => study[name]);
    sheet(
      words.consent.heading,
      paragraph(study.consent || words.consent.text),
      paragraph(fields.map((name) => fill(words.consent[name], study)).join("\n")),
      Object.keys(panel).length ? paragraph(fill(words.consent.panel, { names: Object.keys(panel).join(", ") })) : null,
      paragraph(`${fill(words.consent.length, { minutes: study.minutes, pages: study.lists[list].length })}\n${words.consent[study.postTo ? "sent" : "stored"]}`),
      make("label", { className: "agree", htmlFor: "agree" }, box, make("span", {}, words.consent.agree)),
      make("div", { className: "actions next" }, start)
    );
  }

  // ---------------------------------------------------------------- headphones
  // After Woods et al. (2017): of three tones one is quieter; another has opposite phase in the two
  // ears, so that over loudspeakers it, and not the quiet one, is heard as the quietest.

  const ROUNDS = 3;
  const TRIES = 2;
  const TONE_S = 1.3; // from one to the next

  function showSoundCheck() {
    const text = words.headphones;
    let round = 0;
    let tries = 0;
    let quiet = 0;
    let context = null;
    const message = make("p", { className: "hint", role: "status" });
    const choices = text.choices.map((label, index) => button(label, () => choose(index), { disabled: true }));
    const play = button(text.play, playTones, { className: "main" });
    const last = actions(button(text.skip, () => end("skipped"), {}));

    function end(result) {
      about.headphones = result;
      goTo("practice");
    }

    function playTones() {
      context = context || new AudioContext();
      const kinds = ["quiet", "opposite", "plain"].sort(() => randomBelow(3) - 1);
      quiet = kinds.indexOf("quiet");
      play.disabled = true;
      kinds.forEach((kind, index) => tone(context, context.currentTime + 0.1 + TONE_S * index, kind));
      setTimeout(() => [play, ...choices].forEach((each) => (each.disabled = false)), 1000 * TONE_S * kinds.length);
    }

    function choose(index) {
      choices.forEach((choice) => (choice.disabled = true));
      if (index === quiet) {
        round += 1;
        message.textContent = fill(text.next, { number: round + 1, total: ROUNDS });
        if (round === ROUNDS) end("passed");
        return;
      }
      round = 0;
      tries += 1;
      message.textContent = tries < TRIES ? text.retry : text.failed;
      if (tries < TRIES) return;
      play.hidden = true;
      last.replaceChildren(button(text.continue, () => end("failed"), { className: "main" }));
    }

    sheet(text.heading, paragraph(text.text), actions(play), actions(...choices), message, last);
  }

  function tone(context, start, kind) {
    const buffer = context.createBuffer(2, context.sampleRate, context.sampleRate);
    const level = kind === "quiet" ? 0.15 : 0.3; // 6 dB apart
    const ramp = 0.1 * context.sampleRate;
    for (const channel of [0, 1]) {
      const samples = buffer.getChannelData(channel);
      const sign = kind === "opposite" && channel === 1 ? -1 : 1;
      for (let i = 0; i < samples.length; i += 1) {
        const edge = Math.min(1, i / ramp, (samples.length - i) / ramp);
        samples[i] = sign * level * edge * Math.sin((2 * Math.PI * 200 * i) / context.sampleRate);
      }
    }
    const source = context.createBufferSource();
    source.buffer = buffer;
    source.connect(context.destination);
    source.start(start);
  }

  // ---------------------------------------------------------------- trials

  function showTrial() {
    const [id, shown] = study.lists[list][place()];
    const trial = study.trials[id];
    openDraft(id);
    if (trial.kind === "attention") showAttention(id, trial);
    else {
      const finish = (skipped) => finishPage(id, shown, study.questions, skipped);
      showVideos(study.instruction, trial.kind, shown, makeVideo, () => finish(null), finish);
    }
    preload(place() + 1);
  }

  /** A page like the first one with videos, of which nothing is kept. */
  function showPractice() {
    const [id, shown] = study.lists[list].find(([trial]) => study.trials[trial].kind !== "attention");
    openDraft("practice");
    const dots = shown.map((_, index) => `dot-${index}`);
    showVideos(words.practice.instruction, study.trials[id].kind, dots, makeDot, () => goTo("trial"));
    preload(0);
  }

  function showAttention(id, trial) {
    const question = { id: "attention", kind: "choice", text: "" };
    const heading = make("h1", { className: "press" }, fill(words.attention.text, { button: words.buttons[trial.press] }));
    showPage([heading], [choiceQuestion(question, ["left", "tie", "right"], () => shownPage.update())], [question],
      () => true, () => finishPage(id, [], [question]), []);
  }

  function showVideos(instruction, kind, shown, makeFilm, onNext, onSkip) {
    const isPair = kind === "pair" || kind === "match";
    const names = shown.map((_, i) => (isPair ? words.buttons[["left", "right"][i]] : String(i + 1)));
    const change = () => shownPage.update();
    const stage = makeStage(shown, names, makeFilm, change, onSkip);
    const parts = study.questions.map((question) => {
      if (question.kind === "choice") return choiceQuestion(question, [shown[0], "tie", shown[1]], change);
      return (question.kind === "ranking" ? rankingQuestion : sliderQuestion)(question, shown, names, change);
    });
    if (isPair && study.reasons) parts.push(reasonsQuestion(change));
    const hint = make("p", { className: "hint", role: "status" });
    const keys = fill(isPair ? words.progress.keys : words.progress.keys_many, { videos: shown.length });
    const areWatched = () => shown.every((video) => draft.watched[video]);
    const heading = make("h1", { className: "lead" }, instruction);
    showPage([heading, stage.element, hint], [...parts, stage], study.questions, areWatched, onNext,
      [make("p", { className: "hint keys" }, keys)], (isWatched, isAnswered) => {
        hint.textContent = !isWatched ? words.progress.unwatched
          : !isAnswered && study.questions.length > 1 ? words.progress.unanswered : "";
      });
  }

  let shownPage = null; // of a trial

  /** A page of questions and the button that leads on, which opens once all are answered. */
  function showPage(above, parts, questions, areWatched, onNext, below, tell = () => {}) {
    const next = button(words.buttons.next, onNext, { className: "main", id: "next" });

    function update() {
      keepDraft();
      const isWatched = areWatched();
      const isAnswered = questions.every(({ id, kind }) => {
        const value = draft.values[id];
        if (kind === "ranking") return Boolean(value) && value.length === parts[0].count;
        if (kind === "slider") return Boolean(value) && Object.keys(value).length === parts[0].count;
        return value !== undefined;
      });
      parts.forEach((part) => part.enable && part.enable(isWatched, isAnswered));
      next.disabled = !(isWatched && isAnswered);
      tell(isWatched, isAnswered);
    }

    shownPage = { update };
    const fields = parts.filter((part) => part.enable).map((part) => part.element);
    show(above[0], ...above, ...fields, make("div", { className: "actions next" }, next), ...below);
    update();
    onKey = (event) => parts.some((part) => part.onKey && part.onKey(event)) || enterKey(event, next);
  }

  function enterKey(event, next) {
    const isControl = event.target.closest("button, a, input[type=checkbox]");
    if (event.key !== "Enter" || isControl || next.disabled) return false;
    next.click();
    return true;
  }

  /** Keep the answers and go on; `skipped` is a video that could not be played, for which there are none. */
  function finishPage(id, shown, questions, skipped = null) {
    keepDraft();
    pages[id] = questions.map((question) => ({
      trial: id,
      question: question.id,
      shown,
      value: skipped ? null : draft.values[question.id],
      reasons: question.kind === "choice" && !skipped ? draft.reasons : [],
      watched: shown.length ? Math.min(...shown.map((video) => draft.watched[video] || 0)) : 0,
      ms: draft.ms,
      ...(skipped ? { skipped } : {}),
    }));
    keep(`page/${id}`, pages[id]);
    keep("draft", null);
    goTo("trial");
    sendSoon();
  }

  function preload(number) {
    const [, shown] = study.lists[list][number] || [null, []];
    for (const id of shown) make("video", { preload: "auto", muted: true, src: `media/${id}.mp4` });
  }

  // ---------------------------------------------------------------- videos

  const HANG_MS = 20000; // without a new picture

  /** The videos of a page. One plays at a time, from its start, without a way to skip ahead. One that cannot be played
   * is tried again; from the second failure on the page can be skipped. */
  function makeStage(shown, names, makeFilm, onChange, onSkip) {
    const cards = shown.map((id, index) => makeCard(id, names[index]));
    const element = make("div", { className: "videos", "data-count": shown.length > 3 ? "many" : String(shown.length) },
      ...cards.map((card) => card.element));

    function makeCard(id, name) {
      const video = makeFilm(id, name);
      const action = make("span", { className: "action" });
      const play = make("button", { type: "button", className: "play", onclick: () => toggle(card) },
        make("span", { className: "sign", "aria-hidden": "true" }), make("span", { className: "name" }, name), action);
      const full = document.fullscreenEnabled ? button(words.buttons.full, () => (document.fullscreenElement ? document.exitFullscreen() : card.element.requestFullscreen()), { className: "full" }) : null;
      const card = { video, element: make("div", { className: "card" }, ...[video, full, play].filter(Boolean)), refresh, isWhole: false };
      const spoil = () => (card.isWhole = false);

      function refresh() {
        const watches = draft.watched[id] || 0;
        card.element.classList.toggle("playing", !video.paused);
        card.element.classList.toggle("seen", watches > 0);
        action.textContent = words.buttons[!video.paused ? "pause" : watches ? "replay" : "play"];
        element.classList.toggle("busy", cards.some((other) => !other.video.paused));
      }

      const listeners = {
        play: refresh,
        pause: refresh,
        click: () => toggle(card),
        contextmenu: (event) => event.preventDefault(),
        seeking: () => video.currentTime > 0 && spoil(), // by a media key or a browser's own menu
        ratechange: spoil,
        ended: () => {
          if (card.isWhole) draft.watched[id] = (draft.watched[id] || 0) + 1;
          clearFailure();
          refresh();
          onChange();
        },
      };
      for (const [event, listener] of Object.entries(listeners)) video.addEventListener(event, listener);
      let note = null;
      const clearFailure = () => note && note.remove();

      function fail() {
        draft.failed[id] = (draft.failed[id] || 0) + 1;
        video.pause();
        clearFailure();
        const retry = button(words.buttons.retry, () => {
          clearFailure();
          video.load();
        });
        const skip = draft.failed[id] > 1 ? button(words.buttons.skip, () => onSkip(id)) : null;
        note = make("div", {}, problem(words.problems.video), actions(retry, skip));
        card.element.append(note);
        onChange();
      }

      video.addEventListener("error", fail);
      card.fail = fail;
      return card;
    }

    /** Call it a failure where no picture follows for long. */
    function watch(card) {
      const { currentTime } = card.video;
      clearTimeout(card.timer);
      card.timer = setTimeout(() => {
        if (!card.video.paused) (card.video.currentTime === currentTime ? card.fail : watch)(card);
      }, HANG_MS);
    }

    function toggle(card) {
      const wasPlaying = !card.video.paused;
      cards.forEach(({ video }) => {
        video.pause();
        video.currentTime = 0;
      });
      card.isWhole = true;
      if (wasPlaying) return;
      card.video.play().catch(() => card.refresh());
      watch(card);
    }

    cards.forEach((card) => card.refresh());
    return {
      element,
      onKey: (event) => {
        const card = cards[Number(event.key) - 1];
        if (!card || event.target.closest("input[type=range]")) return false;
        toggle(card);
        return true;
      },
    };
  }

  function makeVideo(id, name) {
    return make("video", { preload: "auto", playsInline: true, muted: !study.sound, disablePictureInPicture: true,
      "aria-label": name, src: `media/${id}.mp4` });
  }

  const DOT_MS = 1500; // as study.css has it

  /** What stands in for a video in the practice: a dot that crosses the picture, each in its way. */
  function makeDot(id, name) {
    const film = make("div", { className: "film", role: "img", "aria-label": name }, make("i", {}));
    const tell = (event) => film.dispatchEvent(new Event(event));
    let timer = 0;

    film.pause = () => {
      if (film.paused) return;
      clearTimeout(timer);
      film.classList.remove("moves");
      tell("pause");
    };
    film.play = async () => {
      film.classList.add("moves");
      tell("play");
      timer = setTimeout(() => {
        film.pause();
        tell("ended");
      }, DOT_MS);
    };
    Object.defineProperty(film, "paused", { get: () => !film.classList.contains("moves") });
    return film;
  }

  // ---------------------------------------------------------------- questions

  function makeFieldset(legend, className, ...children) {
    return make("fieldset", {}, legend ? make("legend", {}, legend) : null, make("div", { className }, ...children));
  }

  /** What a question is to its page; it opens once all videos have been seen. */
  function asQuestion(element, others = {}) {
    return { element, enable: (isWatched) => (element.disabled = !isWatched), ...others };
  }

  /** Left, equal, right. */
  function choiceQuestion(question, values, onChange) {
    const labels = [words.buttons.left, words.buttons.tie, words.buttons.right];
    const inputs = values.map((value, index) => make("input", {
      type: "radio", name: question.id, id: `${question.id}-${index}`,
      checked: draft.values[question.id] === value,
      onchange: () => {
        draft.values[question.id] = value;
        onChange();
      },
    }));
    const parts = inputs.flatMap((input, index) => [input, make("label", { htmlFor: input.id }, labels[index])]);
    const element = makeFieldset(question.text, "choices", ...parts);
    return asQuestion(element, {
      onKey: (event) => {
        const input = inputs[["ArrowLeft", "ArrowDown", "ArrowRight"].indexOf(event.key)];
        if (!input || element.disabled) return false;
        input.click();
        input.focus();
        return true;
      },
    });
  }

  /** Videos are tapped from best to worst; the last one follows by itself. */
  function rankingQuestion(question, shown, names, onChange) {
    const order = () => draft.values[question.id] || [];
    const buttons = shown.map((video, index) => button(names[index], () => choose(video), {}));
    const undo = button(words.buttons.undo, () => set([]), { className: "undo" });
    const element = makeFieldset(question.text, "ranks", ...buttons, undo);
    element.append(make("p", { className: "hint" }, words.progress.order));

    function choose(video) {
      if (order().includes(video)) return set(order().filter((other) => other !== video));
      const chosen = [...order(), video];
      const left = shown.filter((other) => !chosen.includes(other));
      return set(left.length === 1 ? [...chosen, left[0]] : chosen);
    }

    function set(value) {
      draft.values[question.id] = value;
      refresh();
      onChange();
    }

    function refresh() {
      buttons.forEach((one, index) => {
        const rank = order().indexOf(shown[index]) + 1;
        if (rank) one.dataset.rank = rank;
        else delete one.dataset.rank;
        one.setAttribute("aria-label", rank ? `${names[index]}: ${rank}` : names[index]);
      });
      undo.disabled = order().length === 0;
    }

    refresh();
    return asQuestion(element, { count: shown.length });
  }

  /** One slider for each video, from 0 to 100; it counts once it has been touched. */
  function sliderQuestion(question, shown, names, onChange) {
    const values = () => draft.values[question.id] || {};
    const rows = shown.map((video, index) => {
      const has = video in values();
      const input = make("input", {
        type: "range", min: 0, max: 100, step: 1, "aria-label": `${names[index]}: ${question.text}`,
        className: has ? "" : "untouched", value: has ? values()[video] : 50,
      });
      const number = make("output", {}, has ? input.value : "–");
      input.oninput = input.onpointerup = () => {
        input.className = "";
        number.textContent = input.value;
        draft.values[question.id] = { ...values(), [video]: Number(input.value) };
        onChange();
      };
      return make("div", { className: "slider" }, make("b", {}, names[index]), input, number);
    });
    const ends = make("div", { className: "ends" }, make("span", {}, words.slider.low), make("span", {}, words.slider.high));
    return asQuestion(makeFieldset(question.text, "sliders", ends, ...rows), { count: shown.length });
  }

  /** Any number of reasons for a choice; they appear once it is made. */
  function reasonsQuestion(onChange) {
    const parts = study.reasons.choices.flatMap((reason) => {
      const input = make("input", {
        type: "checkbox", id: `reason-${reason.id}`, checked: draft.reasons.includes(reason.id),
        onchange: () => {
          const others = draft.reasons.filter((id) => id !== reason.id);
          draft.reasons = input.checked ? [...others, reason.id] : others;
          onChange();
        },
      });
      return [input, make("label", { htmlFor: input.id }, reason.text)];
    });
    const element = makeFieldset(study.reasons.text, "reasons", ...parts);
    return { element, enable: (isWatched, isAnswered) => (element.hidden = !isAnswered) };
  }

  // ---------------------------------------------------------------- the end

  function showFinish() {
    const text = words.finish;
    if (!about.finished) {
      about.finished = new Date().toISOString();
      keep("about", about);
    }
    const toWhom = (withContact, withoutContact) => fill(study.contact ? withContact : withoutContact, study);
    const isOver = isSent() || Boolean(about.saved);
    const asks = postTo ? text.post : toWhom(text.file_to, text.file);
    const saved = about.saved && `${fill(text.saved, { file: about.saved })} ${toWhom(text.saved_to, text.saved_for)}`;
    const message = make("p", { role: "status" }, isSent() ? text.sent : saved || asks);
    const download = button(words.buttons.download, saveFile, { className: postTo || isOver ? "" : "main" });
    const send = postTo && !isSent() ? button(words.buttons.send, sendAnswers, { className: isOver ? "" : "main" }) : null;

    async function sendAnswers() {
      send.disabled = true;
      if (await sendSoon()) return;
      message.textContent = text.failed;
      send.disabled = false;
    }

    sheet(
      text.heading,
      paragraph(text.text),
      message,
      isOver || !study.returnTo ? null : paragraph(text.then),
      actions(send, download, isOver ? backLink() : null),
      // Only now: whoever starts anew can no longer reach the answers of the one before.
      isOver ? actions(button(words.buttons.again, startAgain, {})) : null
    );
  }

  /** To the service that sent the participant; a preview shows where it leads and goes nowhere. */
  function backLink() {
    if (!study.returnTo) return null;
    if (isPreview) return make("span", {}, `${words.finish.back}: ${study.returnTo}`);
    return make("a", { href: study.returnTo, className: "main" }, words.finish.back);
  }

  function saveFile() {
    const content = new Blob([JSON.stringify(answersFile(), null, 1)], { type: "application/json" });
    about.saved = `${isPreview ? "preview" : "answers"}-${study.study}-${who}.json`;
    const link = make("a", { download: about.saved, href: URL.createObjectURL(content) });
    link.click();
    setTimeout(() => URL.revokeObjectURL(link.href), 10000);
    goTo("trial");
  }

  // All answers so far are sent after each page, and again until they have arrived.

  const FIRST_WAIT_MS = 5000;
  const LONGEST_WAIT_MS = 60000;
  let sending = null;
  let wait = FIRST_WAIT_MS;

  function sendSoon() {
    if (!postTo || about.arrived === answers().length) return Promise.resolve(isSent());
    sending = sending || sendAll().finally(() => (sending = null));
    return sending;
  }

  async function sendAll() {
    const sender = who;
    while (about.arrived !== answers().length && who === sender) {
      const count = answers().length;
      if (!(await post())) {
        setTimeout(sendSoon, wait);
        wait = Math.min(2 * wait, LONGEST_WAIT_MS);
        return false;
      }
      wait = FIRST_WAIT_MS;
      if (who !== sender) break;
      about.arrived = count;
      keep("about", about);
    }
    if (isSent()) render();
    return isSent();
  }

  async function post() {
    try {
      const headers = { "Content-Type": "application/json" };
      return (await fetch(postTo, { method: "POST", headers, body: JSON.stringify(answersFile()) })).ok;
    } catch {
      return false;
    }
  }

  window.addEventListener("online", () => about && sendSoon());

  function startAgain() {
    load(true);
    render();
  }

  // ---------------------------------------------------------------- start

  document.addEventListener("keydown", (event) => {
    if (event.ctrlKey || event.metaKey || event.altKey || !onKey) return;
    if (onKey(event)) event.preventDefault();
  });

  if (isPreview) document.body.prepend(make("p", { className: "preview", role: "note" }, words.preview.text));
  if (listParam !== null && !(/^\d{1,6}$/.test(listParam) && Number(listParam) < study.lists.length)) {
    show(null, problem(words.problems.list));
  } else {
    load();
    render();
    sendSoon();
  }
})();
